/* SPDX-License-Identifier: MIT */
/* One long trajectory of a Dahl element by the scan of fast_scan.h: by counts and by angles. */
#include <stddef.h>

#include <string.h>

#include "fast_scan.h"

typedef struct {
    const dahl_throughput_scale_t *scale;
    dahl_state_t *state;
    const void *moves; /* int32_t or float */
    float *F;
    size_t n;
} job_t;

DAHL_INLINE void write_torques(const scan_t *scan, double w0, double Fc, float *F)
{
    for (int i = 0; i < GROUPS; i++) {
        double d = scan->d[i];
        DAHL_UNROLL_8
        for (int k = 0; k < GROUP; k++) {
            d = scan->e[k][i] * d + scan->c[k][i];
            F[GROUP * i + k] = (float)(Fc * (w0 + d));
        }
    }
}

DAHL_INLINE void run_block(scan_t *scan, const job_t *job, const void *moves, size_t n, float *F, dahl_value_t value,
                           dahl_value_t number, dahl_measure_t measure)
{
    double w0 = dahl_w_of(job->state);
    scan_block(scan, job->scale, w0, moves, n, value, number, measure);
    dahl_carry(job->state, join_groups(scan));
    write_torques(scan, w0, job->scale->Fc, F + n);
}

/* The last ticks, filled up to a block with ticks that do not move. */
DAHL_INLINE void run_rest(scan_t *scan, const job_t *job, size_t done, dahl_value_t value,
                          dahl_value_t number, dahl_measure_t measure)
{
    uint32_t moves[BLOCK];
    float F[BLOCK];
    size_t rest = job->n - done;
    for (size_t i = 0; i < BLOCK; i++) {
        moves[i] = 0;
        if (i < rest) {
            (void)memcpy(&moves[i], (const uint32_t *)job->moves + done + i, sizeof moves[i]);
        }
    }
    run_block(scan, job, moves, 0, F, value, number, measure);
    for (size_t i = 0; i < rest; i++) {
        job->F[done + i] = F[i];
    }
}

DAHL_INLINE void run(const job_t *job, dahl_value_t value, dahl_value_t number, dahl_measure_t measure)
{
    scan_t scan;
    size_t left = job->n;
    for (; left / BLOCK != 0; left -= BLOCK) {
        run_block(&scan, job, job->moves, job->n - left, job->F, value, number, measure);
    }
    if (left != 0) {
        run_rest(&scan, job, job->n - left, value, number, measure);
    }
}

DAHL_INLINE void run_counts(const job_t *job) { run(job, dahl_value_of_count, dahl_value_of_count, dahl_measure_of_count); }
DAHL_INLINE void run_angles(const job_t *job) { run(job, dahl_value_of_angle, dahl_number_of_angle, dahl_measure_of_angle); }
DAHL_VARIANTS(counts, job_t, run_counts)
DAHL_VARIANTS(angles, job_t, run_angles)

dahl_err_t dahl_throughput_counts(const dahl_throughput_params_t *params, dahl_state_t *state, const int32_t *dcounts, float *F,
                                  size_t n)
{
    dahl_throughput_scale_t scale;
    dahl_err_t err = dahl_throughput_check(params, true, &scale);
    if (err == DAHL_OK) {
        job_t job = {&scale, state, dcounts, F, n};
        counts(&job);
    }
    return err;
}

dahl_err_t dahl_throughput(const dahl_throughput_params_t *params, dahl_state_t *state, const float *dtheta, float *F, size_t n)
{
    dahl_throughput_scale_t scale;
    dahl_err_t err = dahl_throughput_check(params, false, &scale);
    if (err == DAHL_OK) {
        job_t job = {&scale, state, dtheta, F, n};
        angles(&job);
    }
    return err;
}

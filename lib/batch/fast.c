/* SPDX-License-Identifier: MIT */
/*
 * One long trajectory by a scan. A tick is the affine map d -> e d + c, with e = 1 - g and c = (s - w0) g, and so are
 * several ticks in a row. For a block of ticks:
 *   1. e and c of every tick, and from them the map of each group of 8 ticks
 *   2. d at the start of each group, one after the other: the only serial part, one product for 8 ticks
 *   3. d of every tick within its group, and the torque
 * The compiler makes vectors of 1 and 3.
 */
#include <stddef.h>

#include <string.h>

#include "fast.h"

#define GROUP 8
#define GROUPS 64
#define BLOCK (GROUP * GROUPS)

typedef struct {
    double e[GROUP][GROUPS], c[GROUP][GROUPS]; /* of tick k of group i */
    double group_e[GROUPS], group_c[GROUPS];
    double d[GROUPS]; /* at the start of each group */
} scan_t;

typedef struct {
    const dahl_throughput_scale_t *scale;
    dahl_state_t *state;
    const void *moves; /* int32_t or float */
    float *F;
    size_t n;
} job_t;

DAHL_INLINE uint32_t largest(const void *moves, size_t n, dahl_measure_t measure)
{
    uint32_t most = measure(moves, n);
    for (size_t left = BLOCK; left != 0; left--) {
        uint32_t size = measure(moves, n + BLOCK - left);
        most = size > most ? size : most;
    }
    return most;
}

DAHL_INLINE void make_maps(scan_t *scan, const void *moves, size_t n, double a, double w0, dahl_value_t value, dahl_g_t g_of)
{
    for (size_t i = 0; i < GROUPS; i++) {
        double group_e = 1.0, group_c = 0.0;
        DAHL_UNROLL_8
        for (size_t k = 0; k < GROUP; k++) {
            double g = g_of(a * value(moves, n + GROUP * i + k));
            double e = 1.0 - fabs(g), c = g - w0 * fabs(g);
            scan->e[k][i] = e;
            scan->c[k][i] = c;
            group_c = e * group_c + c;
            group_e *= e;
        }
        scan->group_e[i] = group_e;
        scan->group_c[i] = group_c;
    }
}

/* Returns d at the end of the block. */
DAHL_INLINE double join_groups(scan_t *scan)
{
    double d = 0.0;
    for (int i = 0; i < GROUPS; i++) {
        scan->d[i] = d;
        d = scan->group_e[i] * d + scan->group_c[i];
    }
    return d;
}

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
    double w0 = dahl_w_of(job->state), a = job->scale->a;
    uint32_t most = largest(moves, n, measure);
    if (most > job->scale->small) {
        make_maps(scan, moves, n, a, w0, value, dahl_g_any);
    } else if (most <= job->scale->tiny) {
        make_maps(scan, moves, n, a, w0, number, dahl_g_tiny);
    } else {
        make_maps(scan, moves, n, a, w0, number, dahl_g_small);
    }
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

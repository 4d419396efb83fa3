/* SPDX-License-Identifier: MIT */
/*
 * One long trajectory by a scan. A tick is the affine map d -> e d + c, with e = 1 - g and c = (s - w0) g, and so are
 * several ticks in a row. For a block of ticks:
 *   1. the travel of every tick, with the sign of its direction
 *   2. e and c of every tick, and from them the map of each group of 8 ticks
 *   3. d at the start of each group, one after the other: the only serial part, one product for 8 ticks
 *   4. d of every tick within its group, and the torque
 * The compiler makes vectors of 1, 2 and 4.
 */
#include <stddef.h>

#include "batch_throughput.h"

#define GROUP 8
#define GROUPS 64
#define BLOCK (GROUP * GROUPS)

typedef struct {
    double travel[BLOCK];
    double e[GROUP][GROUPS], c[GROUP][GROUPS]; /* of tick k of group i */
    double group_e[GROUPS], group_c[GROUPS];
    double d[GROUPS]; /* at the start of each group */
} scan_t;

typedef struct {
    dahl_throughput_scale_t scale;
    dahl_state_t *state;
    const void *moves; /* int32_t or float */
    float *F;
    size_t n;
} job_t;

/* Read BLOCK moves from the n-th on; returns whether one is above ln 2. */
typedef int (*take_t)(scan_t *scan, const void *moves, size_t n, double a);

DAHL_INLINE int take_counts(scan_t *scan, const void *moves, size_t n, double a)
{
    const int32_t *dcounts = (const int32_t *)moves + n;
    int above = 0;
    for (int i = 0; i < BLOCK; i++) {
        scan->travel[i] = dahl_travel(a, (double)dcounts[i]);
        above |= dahl_is_above_ln2(scan->travel[i]);
    }
    return above;
}

DAHL_INLINE int take_angles(scan_t *scan, const void *moves, size_t n, double a)
{
    const float *dtheta = (const float *)moves + n;
    int above = 0;
    for (int i = 0; i < BLOCK; i++) {
        scan->travel[i] = dahl_travel(a, (double)dtheta[i]);
        above |= dahl_is_above_ln2(scan->travel[i]);
    }
    return above;
}

DAHL_INLINE void make_maps(scan_t *scan, double w0, dahl_g_t g_of)
{
    for (int i = 0; i < GROUPS; i++) {
        double group_e = 1.0, group_c = 0.0;
#pragma GCC unroll 8
        for (int k = 0; k < GROUP; k++) {
            double v = scan->travel[GROUP * i + k], s = dahl_direction(v);
            double g = g_of(v * s), e = 1.0 - g, c = (s - w0) * g;
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
#pragma GCC unroll 8
        for (int k = 0; k < GROUP; k++) {
            d = scan->e[k][i] * d + scan->c[k][i];
            F[GROUP * i + k] = (float)(Fc * (w0 + d));
        }
    }
}

DAHL_INLINE void run_block(scan_t *scan, int above, double Fc, dahl_state_t *state, float *F)
{
    double w0 = dahl_w_of(state);
    if (above) {
        make_maps(scan, w0, dahl_g_any);
    } else {
        make_maps(scan, w0, dahl_g_small);
    }
    dahl_carry(state, join_groups(scan));
    write_torques(scan, w0, Fc, F);
}

/* The last ticks, filled up to a block with ticks that do not move. */
DAHL_INLINE void run_rest(const job_t *job, size_t done, scan_t *scan, take_t take)
{
    unsigned char moves[BLOCK * 4] = {0};
    float F[BLOCK];
    for (size_t i = 0; i < 4 * (job->n - done); i++) {
        moves[i] = ((const unsigned char *)job->moves)[4 * done + i];
    }
    int above = take(scan, moves, 0, job->scale.a);
    run_block(scan, above, job->scale.Fc, job->state, F);
    for (size_t i = 0; done + i < job->n; i++) {
        job->F[done + i] = F[i];
    }
}

DAHL_INLINE void run(const job_t *job, take_t take)
{
    scan_t scan;
    size_t done = 0;
    for (; job->n - done >= BLOCK; done += BLOCK) {
        int above = take(&scan, job->moves, done, job->scale.a);
        run_block(&scan, above, job->scale.Fc, job->state, job->F + done);
    }
    if (done < job->n) {
        run_rest(job, done, &scan, take);
    }
}

DAHL_INLINE void run_counts(const job_t *job) { run(job, take_counts); }
DAHL_INLINE void run_angles(const job_t *job) { run(job, take_angles); }
DAHL_VARIANTS(counts, job_t, run_counts)
DAHL_VARIANTS(angles, job_t, run_angles)

dahl_err_t dahl_throughput_counts(const dahl_throughput_params_t *params, dahl_state_t *state, const int32_t *dcounts, float *F,
                                  size_t n)
{
    job_t job = {{0, 0}, state, dcounts, F, n};
    dahl_err_t err = dahl_throughput_check(params, 1, &job.scale);
    if (err == DAHL_OK) {
        counts(&job);
    }
    return err;
}

dahl_err_t dahl_throughput(const dahl_throughput_params_t *params, dahl_state_t *state, const float *dtheta, float *F, size_t n)
{
    job_t job = {{0, 0}, state, dtheta, F, n};
    dahl_err_t err = dahl_throughput_check(params, 0, &job.scale);
    if (err == DAHL_OK) {
        angles(&job);
    }
    return err;
}

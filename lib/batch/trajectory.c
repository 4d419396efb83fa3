/* SPDX-License-Identifier: MIT */
/**
 * One long trajectory of a Dahl element by a scan. A tick is the affine map d -> e d + c, and so are several ticks
 * in a row. For one tick, e = 1 - g and c = (s - w0) g. For a block of ticks:
 * -# Compute e and c of every tick, and from them the map of each group of 8 ticks.
 * -# Compute d at the start of each group: the only serial part, one product for 8 ticks.
 * -# Compute d of every tick, and the torque.
 *
 * The compiler vectorizes steps 1 and 3 of this form. With AVX-512, trajectory_tiles.h replaces it. With AVX2,
 * trajectory_segments.h does, for counts that a table of maps covers.
 */
#include <stddef.h>
#include <string.h>

#include "throughput.h"
#include "trajectory_segments.h"
#include "trajectory_tiles.h"

#define GROUP 8
#define GROUPS 64
#define BLOCK (GROUP * GROUPS)

typedef struct {
    const dahl_throughput_scale_t *scale;
    dahl_state_t *state;
    const void *moves; /* int32_t or float */
    float *F;
    size_t n;
    const void *wide_table; /* dahl_wide_table_t of trajectory_tiles.h */
    void *pair_table;       /* dahl_pair_table_t of trajectory_segments.h */
} job_t;

typedef struct {
    double e[GROUP][GROUPS], c[GROUP][GROUPS]; /* tick k of group i */
    double group_e[GROUPS], group_c[GROUPS];
    double d[GROUPS]; /* d at the start of each group */
} scan_t;

DAHL_INLINE uint32_t largest(const void *moves, dahl_measure_t measure)
{
    uint32_t most = measure(moves, 0);
    for (size_t i = 0; i < BLOCK; i++) { /* all of them: whole vectors */
        uint32_t size = measure(moves, i);
        most = size > most ? size : most;
    }
    return most;
}

DAHL_INLINE void make_maps(scan_t *scan, const void *moves, double a, double w0, dahl_value_t value, dahl_g_t g_of)
{
    for (size_t i = 0; i < GROUPS; i++) {
        double group_e = 1.0, group_c = 0.0;
        DAHL_UNROLL_8
        for (size_t k = 0; k < GROUP; k++) {
            double g = g_of(a * value(moves, GROUP * i + k));
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

/** Processes a block from w0. Returns d at its end. */
typedef double (*block_t)(const job_t *job, double w0, const void *moves, float *F);

DAHL_INLINE double scan_and_write(const job_t *job, double w0, const void *moves, float *F, dahl_value_t value,
                                  dahl_value_t number, dahl_measure_t measure)
{
    const double a = job->scale->a;
    uint32_t most = largest(moves, measure);
    scan_t scan;
    if (most > job->scale->small) {
        make_maps(&scan, moves, a, w0, value, dahl_g_any);
    } else if (most <= job->scale->tiny) {
        make_maps(&scan, moves, a, w0, number, dahl_g_tiny);
    } else {
        make_maps(&scan, moves, a, w0, number, dahl_g_small);
    }
    double d = join_groups(&scan);
    write_torques(&scan, w0, job->scale->Fc, F);
    return d;
}

DAHL_INLINE double counts_block(const job_t *job, double w0, const void *moves, float *F)
{
    return scan_and_write(job, w0, moves, F, dahl_value_of_count, dahl_value_of_count, dahl_measure_of_count);
}

DAHL_INLINE double angles_block(const job_t *job, double w0, const void *moves, float *F)
{
    return scan_and_write(job, w0, moves, F, dahl_value_of_angle, dahl_number_of_angle, dahl_measure_of_angle);
}

/** The last ticks, padded to a block with ticks without motion. */
typedef struct {
    union {
        int32_t counts[BLOCK];
        float angles[BLOCK];
    } moves;
    float F[BLOCK];
} last_t;

/** Copy n ticks, from tick `done` on, and set the pointers of the block. */
DAHL_INLINE void copy_last(last_t *last, const job_t *job, size_t done, size_t n, const void **moves, float **F)
{
    (void)memcpy(last->moves.counts, (const int32_t *)job->moves + done, n * sizeof last->moves.counts[0]);
    *moves = &last->moves;
    *F = last->F;
}

DAHL_INLINE void run(const job_t *job, block_t block)
{
    last_t last = {{{0}}, {0}};
    for (size_t done = 0; done < job->n; done += BLOCK) {
        size_t n = job->n - done;
        const void *moves = (const int32_t *)job->moves + done;
        float *F = job->F + done;
        if (n < BLOCK) {
            copy_last(&last, job, done, n, &moves, &F);
        }
        dahl_carry(job->state, block(job, dahl_w_of(job->state), moves, F));
        if (n < BLOCK) {
            (void)memcpy(job->F + done, last.F, n * sizeof last.F[0]);
        }
    }
}

#ifdef DAHL_FOUR
typedef char the_segments_are_a_block[DAHL_SEGMENTS_TICKS == BLOCK ? 1 : -1];

DAHL_FOUR double counts_segments(const job_t *job, double w0, const void *moves, float *F)
{
    dahl_pair_table_t *table = job->pair_table;
    dahl_place_t places[BLOCK];
    dahl_pair_place_t pairs[BLOCK / 2]; /* 4 bytes for two ticks, as in places */
    int32_t most = dahl_pair_places(places, pairs, moves);
    if (!dahl_map_cover(&table->single, places, BLOCK, most)) {
        return counts_block(job, w0, moves, F);
    }
    double Fc = table->single.Fc, W = Fc * w0, end;
    if (dahl_pair_cover(table, most)) {
        end = dahl_segments_run(&dahl_pair_center(table)->first.e, pairs, dahl_segment_pair_by_table, W, F);
    } else {
        end = dahl_segments_run(dahl_map_center(&table->single), places, dahl_segment_pair, W, F);
    }
    return (end - W) / Fc;
}

DAHL_FOUR void run_segments(const job_t *job)
{
    dahl_pair_table_t table;
    job_t with_table = *job;
    table.most = -1;
    dahl_map_start(&table.single, job->scale->a, job->scale->Fc, job->n);
    with_table.pair_table = &table;
    run(&with_table, counts_segments);
}
#endif

#ifdef DAHL_AVX512
typedef char the_tiles_are_a_block[DAHL_TILES_TICKS == BLOCK ? 1 : -1];

DAHL_WIDE double counts_tiles(const job_t *job, double w0, const void *moves, float *F)
{
    const dahl_tiles_job_t block = {job->scale, w0, moves, F};
    return dahl_tiles_by_counts(&block, job->wide_table);
}

DAHL_WIDE double angles_tiles(const job_t *job, double w0, const void *moves, float *F)
{
    const dahl_tiles_job_t block = {job->scale, w0, moves, F};
    return dahl_tiles_by_angle(&block);
}

DAHL_WIDE void run_tiles(const job_t *job)
{
    const dahl_wide_table_t table = dahl_wide_table(job->scale->a, job->scale->Fc);
    job_t with_table = *job;
    with_table.wide_table = &table;
    run(&with_table, counts_tiles);
}
#endif

DAHL_VARIANTS(counts, job_t, run_tiles(job), run_segments(job), run(job, counts_block))
DAHL_VARIANTS(angles, job_t, run(job, angles_tiles), run(job, angles_block), run(job, angles_block))

dahl_err_t dahl_throughput_counts(const dahl_throughput_params_t *params, dahl_state_t *state, const int32_t *dcounts, float *F,
                                  size_t n)
{
    dahl_throughput_scale_t scale;
    dahl_err_t err = dahl_throughput_check(params, true, &scale);
    if (err == DAHL_OK && n != 0) {
        dahl_clamp_state(state);
        job_t job = {&scale, state, dcounts, F, n, NULL, NULL};
        counts(&job);
    }
    return err;
}

dahl_err_t dahl_throughput(const dahl_throughput_params_t *params, dahl_state_t *state, const float *dtheta, float *F, size_t n)
{
    dahl_throughput_scale_t scale;
    dahl_err_t err = dahl_throughput_check(params, false, &scale);
    if (err == DAHL_OK && n != 0) {
        dahl_clamp_state(state);
        job_t job = {&scale, state, dtheta, F, n, NULL, NULL};
        angles(&job);
    }
    return err;
}

/* SPDX-License-Identifier: MIT */
/** Many channels: vectors run across the channels, so only the ticks are serial. A block of ticks returns the motion d of
 * each w, which is then carried into the state. The compiler vectorizes the form of this file. With AVX-512,
 * channels_wide.h replaces it; with AVX2, channels_table.h does if a table of maps can serve the block. */
#include <stddef.h>
#include <string.h>

#include "channels_table.h"
#include "channels_wide.h"

/** Largest measure of these ticks. Rows without a gap in memory count as one long row. */
DAHL_INLINE uint32_t largest(const job_t *job, size_t first, size_t last, dahl_measure_t measure)
{
    size_t rows = last - first, width = job->count, start = first * job->stride;
    uint32_t most = measure(job->moves, start);
    if (job->stride == width) {
        width *= rows;
        rows = 1;
    }
    for (size_t t = 0; t < rows; t++) {
        for (size_t c = 0; c < width; c++) {
            uint32_t size = measure(job->moves, start + t * job->stride + c);
            most = size > most ? size : most;
        }
    }
    return most;
}

DAHL_INLINE void step(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last, dahl_value_t value,
                      dahl_g_t g_of)
{
    for (size_t left = last - first; left != 0; left--) {
        size_t t = last - left;
        float *F = job->F + t * job->stride;
        DAHL_AS_VECTORS
        for (size_t c = 0; c < count; c++) {
            double g = g_of(chunk->a[c] * value(job->moves, t * job->stride + c));
            double w = chunk->w0[c] + chunk->d[c];
            double d = chunk->d[c] + (g - w * fabs(g));
            chunk->d[c] = d;
            F[c] = (float)(chunk->Fc[c] * d + chunk->W0[c]);
        }
    }
}

DAHL_INLINE void step_up_to(uint32_t most, chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last,
                            dahl_value_t value, dahl_value_t number)
{
    if (most > chunk->small) {
        step(chunk, job, count, first, last, value, dahl_g_any);
    } else if (most <= chunk->tiny) {
        step(chunk, job, count, first, last, number, dahl_g_tiny);
    } else {
        step(chunk, job, count, first, last, number, dahl_g_small);
    }
}

DAHL_INLINE void step_counts(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last)
{
    uint32_t most = largest(job, first, last, dahl_measure_of_count);
    step_up_to(most, chunk, job, count, first, last, dahl_value_of_count, dahl_value_of_count);
}

DAHL_INLINE void step_angles(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last)
{
    uint32_t most = largest(job, first, last, dahl_measure_of_angle);
    step_up_to(most, chunk, job, count, first, last, dahl_value_of_angle, dahl_number_of_angle);
}

DAHL_INLINE void run_block(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last, steps_t steps)
{
    for (size_t c = 0; c < count; c++) {
        chunk->w0[c] = dahl_w_of(&job->states[c]);
        chunk->W0[c] = chunk->Fc[c] * chunk->w0[c];
        chunk->d[c] = 0.0;
    }
    steps(chunk, job, count, first, last);
    for (size_t c = 0; c < count; c++) {
        dahl_carry(&job->states[c], chunk->d[c]);
    }
}

/** Without ==, against which -Wfloat-equal warns. */
DAHL_INLINE bool is_same(double x, double y)
{
    return x >= y && x <= y;
}

DAHL_INLINE void read_params(chunk_t *chunk, const job_t *job, size_t count)
{
    (void)memset(chunk, 0, sizeof *chunk);
    chunk->small = chunk->tiny = UINT32_MAX;
    chunk->least_a = HUGE_VAL;
    chunk->is_uniform = true;
    for (size_t c = 0; c < count; c++) {
        dahl_throughput_scale_t scale;
        (void)dahl_throughput_check(&job->params[c], job->by_counts, &scale);
        chunk->a[c] = scale.a;
        chunk->Fc[c] = scale.Fc;
        chunk->small = scale.small < chunk->small ? scale.small : chunk->small;
        chunk->tiny = scale.tiny < chunk->tiny ? scale.tiny : chunk->tiny;
        chunk->least_a = scale.a < chunk->least_a ? scale.a : chunk->least_a;
        chunk->is_uniform = chunk->is_uniform && is_same(scale.a, chunk->a[0]) && is_same(scale.Fc, chunk->Fc[0]);
    }
}

DAHL_INLINE void run(const job_t *job, size_t count, steps_t steps)
{
    chunk_t chunk;
    read_params(&chunk, job, count);
    size_t rows;
    for (size_t t = 0; t < job->n; t += rows) {
        rows = job->n - t < BLOCK ? job->n - t : BLOCK;
        run_block(&chunk, job, count, t, t + rows, steps);
    }
}

/** A full chunk passes a constant number of channels to the compiler. */
DAHL_INLINE void run_by_size(const job_t *job, steps_t steps)
{
    if (job->count == CHUNK) {
        run(job, CHUNK, steps);
    } else {
        run(job, job->count, steps);
    }
}

#ifdef DAHL_FOUR
/** Only full chunks of equal channels use the table. */
DAHL_FOUR void step_counts_by_table(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last)
{
    const size_t rows = last - first;
    dahl_map_table_t *table = job->map_table;
    dahl_place_t places[BLOCK * CHUNK];
    if (first == 0) {
        dahl_map_start(table, count == CHUNK && chunk->is_uniform ? chunk->a[0] : 0.0, chunk->Fc[0], job->n * CHUNK);
    }
    if (table->limit > 0) {
        const int32_t *moves = (const int32_t *)job->moves + first * job->stride;
        int32_t most = places_of(places, moves, rows, job->stride);
        if (dahl_map_cover(table, places, rows * CHUNK, most)) {
            step_by_table(chunk, job, places, first, last);
            return;
        }
    }
    step_counts(chunk, job, count, first, last);
}

DAHL_FOUR void run_with_table(const job_t *job)
{
    dahl_map_table_t table;
    job_t with_table = *job;
    with_table.map_table = &table;
    run_by_size(&with_table, step_counts_by_table);
}
#endif

#ifdef DAHL_AVX512
#define TABLE_PAYS 16 /* ticks */

DAHL_WIDE void run_wide_counts(const job_t *job)
{
    job_t with_table = *job;
    dahl_wide_table_t table;
    if (job->n >= TABLE_PAYS) {
        dahl_throughput_scale_t scale;
        (void)dahl_throughput_check(&job->params[0], true, &scale);
        table = dahl_wide_table(scale.a, scale.Fc);
        with_table.wide_table = &table;
    }
    run_by_size(&with_table, step_wide_counts);
}
#endif

DAHL_VARIANTS(counts, job_t, run_wide_counts(job), run_with_table(job), run_by_size(job, step_counts))
DAHL_VARIANTS(angles, job_t, run_by_size(job, step_wide_angles), run_by_size(job, step_angles), run_by_size(job, step_angles))

static dahl_err_t check_all(const dahl_throughput_params_t *params, size_t channels, bool by_counts)
{
    dahl_throughput_scale_t scale;
    dahl_err_t err = DAHL_OK;
    for (size_t left = channels; left != 0 && err == DAHL_OK; left--) {
        err = dahl_throughput_check(&params[channels - left], by_counts, &scale);
    }
    return err;
}

static job_t chunk_of(const job_t *all, size_t first)
{
    job_t job = *all;
    job.params += first;
    job.states += first;
    job.moves = (const unsigned char *)all->moves + 4 * first;
    job.F += first;
    job.count = all->count - first < CHUNK ? all->count - first : CHUNK;
    return job;
}

static dahl_err_t run_all(const job_t *all, void (*run_chunk)(const job_t *))
{
    dahl_err_t err = check_all(all->params, all->count, all->by_counts);
    for (size_t first = 0; first < all->count && all->n != 0 && err == DAHL_OK; first += CHUNK) {
        job_t job = chunk_of(all, first);
        for (size_t c = 0; c < job.count; c++) {
            dahl_clamp_state(&job.states[c]);
        }
        run_chunk(&job);
    }
    return err;
}

dahl_err_t dahl_throughput_counts_channels(const dahl_throughput_params_t *params, dahl_state_t *states, size_t channels,
                                           const int32_t *dcounts, float *F, size_t n)
{
    job_t all = {params, states, dcounts, F, channels, channels, n, true, NULL, NULL};
    return run_all(&all, counts);
}

dahl_err_t dahl_throughput_channels(const dahl_throughput_params_t *params, dahl_state_t *states, size_t channels,
                                    const float *dtheta, float *F, size_t n)
{
    job_t all = {params, states, dtheta, F, channels, channels, n, false, NULL, NULL};
    return run_all(&all, angles);
}

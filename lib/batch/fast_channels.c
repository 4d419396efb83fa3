/* SPDX-License-Identifier: MIT */
/*
 * Many channels side by side: the vectors run across channels, so nothing is serial but the ticks. As for one trajectory
 * only d = w - w0 is computed for a block of ticks, then carried into the state.
 */
#include <stddef.h>

#include "fast.h"

#define CHUNK 16 /* channels at a time */
#define BLOCK 128 /* ticks before d is carried */

typedef struct {
    double a[CHUNK], Fc[CHUNK], w0[CHUNK], F0[CHUNK], d[CHUNK];
    uint32_t small, tiny; /* the least of all channels */
} chunk_t;

typedef struct {
    const dahl_throughput_params_t *params;
    dahl_state_t *states;
    const void *moves; /* int32_t or float, of the first channel of the chunk */
    float *F;
    size_t count, stride, n;
    bool by_counts;
} job_t;

/* The largest measure of these ticks. Rows without a gap between them are one long row. */
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
            F[c] = (float)(chunk->Fc[c] * d + chunk->F0[c]);
        }
    }
}

DAHL_INLINE void run_block(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last, dahl_value_t value,
                           dahl_value_t number, dahl_measure_t measure)
{
    for (size_t c = 0; c < count; c++) {
        chunk->w0[c] = dahl_w_of(&job->states[c]);
        chunk->F0[c] = chunk->Fc[c] * chunk->w0[c];
        chunk->d[c] = 0.0;
    }
    uint32_t most = largest(job, first, last, measure);
    if (most > chunk->small) {
        step(chunk, job, count, first, last, value, dahl_g_any);
    } else if (most <= chunk->tiny) {
        step(chunk, job, count, first, last, number, dahl_g_tiny);
    } else {
        step(chunk, job, count, first, last, number, dahl_g_small);
    }
    for (size_t c = 0; c < count; c++) {
        dahl_carry(&job->states[c], chunk->d[c]);
    }
}

DAHL_INLINE void run(const job_t *job, size_t count, dahl_value_t value, dahl_value_t number,
                     dahl_measure_t measure)
{
    chunk_t chunk;
    chunk.small = chunk.tiny = UINT32_MAX;
    for (size_t c = 0; c < count; c++) {
        dahl_throughput_scale_t scale;
        (void)dahl_throughput_check(&job->params[c], job->by_counts, &scale);
        chunk.a[c] = scale.a;
        chunk.Fc[c] = scale.Fc;
        chunk.small = scale.small < chunk.small ? scale.small : chunk.small;
        chunk.tiny = scale.tiny < chunk.tiny ? scale.tiny : chunk.tiny;
    }
    size_t rows;
    for (size_t t = 0; t < job->n; t += rows) {
        rows = job->n - t < BLOCK ? job->n - t : BLOCK;
        run_block(&chunk, job, count, t, t + rows, value, number, measure);
    }
}

/* A whole chunk has a number of channels that the compiler knows. */
DAHL_INLINE void run_known(const job_t *job, dahl_value_t value, dahl_value_t number,
                           dahl_measure_t measure)
{
    if (job->count == CHUNK) {
        run(job, CHUNK, value, number, measure);
    } else {
        run(job, job->count, value, number, measure);
    }
}

DAHL_INLINE void run_counts(const job_t *job)
{
    run_known(job, dahl_value_of_count, dahl_value_of_count, dahl_measure_of_count);
}

DAHL_INLINE void run_angles(const job_t *job)
{
    run_known(job, dahl_value_of_angle, dahl_number_of_angle, dahl_measure_of_angle);
}
DAHL_VARIANTS(counts, job_t, run_counts)
DAHL_VARIANTS(angles, job_t, run_angles)

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
        run_chunk(&job);
    }
    return err;
}

dahl_err_t dahl_throughput_counts_channels(const dahl_throughput_params_t *params, dahl_state_t *states, size_t channels,
                                           const int32_t *dcounts, float *F, size_t n)
{
    job_t all = {params, states, dcounts, F, channels, channels, n, true};
    return run_all(&all, counts);
}

dahl_err_t dahl_throughput_channels(const dahl_throughput_params_t *params, dahl_state_t *states, size_t channels,
                                    const float *dtheta, float *F, size_t n)
{
    job_t all = {params, states, dtheta, F, channels, channels, n, false};
    return run_all(&all, angles);
}

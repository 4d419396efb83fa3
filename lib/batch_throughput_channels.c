/* SPDX-License-Identifier: MIT */
/*
 * Many channels side by side: the vectors run across channels, so nothing is serial but the ticks. As for one trajectory
 * only d = w - w0 is computed for a block of ticks, then carried into the state.
 */
#include <stddef.h>

#include "batch_throughput.h"

#define CHUNK 16 /* channels at a time */
#define BLOCK 64 /* ticks before d is carried */

typedef struct {
    double a[CHUNK], Fc[CHUNK], w0[CHUNK], d[CHUNK];
} chunk_t;

typedef struct {
    const dahl_throughput_params_t *params;
    dahl_state_t *states;
    const void *moves; /* int32_t or float, of the first channel of the chunk */
    float *F;
    size_t count, stride, n;
    int by_counts;
} job_t;

/* Move number i as a double. */
typedef double (*read_t)(const void *moves, size_t i);

DAHL_INLINE double read_count(const void *moves, size_t i)
{
    return (double)((const int32_t *)moves)[i];
}

DAHL_INLINE double read_angle(const void *moves, size_t i)
{
    return (double)((const float *)moves)[i];
}

DAHL_INLINE int is_above_ln2(const chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t ticks, read_t read)
{
    int above = 0;
    for (size_t t = first; t < first + ticks; t++) {
        for (size_t c = 0; c < count; c++) {
            above |= dahl_is_above_ln2(dahl_travel(chunk->a[c], read(job->moves, t * job->stride + c)));
        }
    }
    return above;
}

DAHL_INLINE void run_ticks(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t ticks, read_t read, dahl_g_t g_of)
{
    for (size_t t = first; t < first + ticks; t++) {
        float *F = job->F + t * job->stride;
        for (size_t c = 0; c < count; c++) {
            double v = dahl_travel(chunk->a[c], read(job->moves, t * job->stride + c)), s = dahl_direction(v);
            double gap = (s - chunk->w0[c]) - chunk->d[c];
            chunk->d[c] += gap * g_of(v * s);
            F[c] = (float)(chunk->Fc[c] * (chunk->w0[c] + chunk->d[c]));
        }
    }
}

DAHL_INLINE void run_block(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t ticks, read_t read)
{
    for (size_t c = 0; c < count; c++) {
        chunk->w0[c] = dahl_w_of(&job->states[c]);
        chunk->d[c] = 0.0;
    }
    if (is_above_ln2(chunk, job, count, first, ticks, read)) {
        run_ticks(chunk, job, count, first, ticks, read, dahl_g_any);
    } else {
        run_ticks(chunk, job, count, first, ticks, read, dahl_g_small);
    }
    for (size_t c = 0; c < count; c++) {
        dahl_carry(&job->states[c], chunk->d[c]);
    }
}

DAHL_INLINE void run(const job_t *job, size_t count, read_t read)
{
    chunk_t chunk;
    for (size_t c = 0; c < count; c++) {
        dahl_throughput_scale_t scale;
        (void)dahl_throughput_check(&job->params[c], job->by_counts, &scale);
        chunk.a[c] = scale.a;
        chunk.Fc[c] = scale.Fc;
    }
    for (size_t t = 0; t < job->n; t += BLOCK) {
        run_block(&chunk, job, count, t, job->n - t < BLOCK ? job->n - t : BLOCK, read);
    }
}

/* A whole chunk has a number of channels that the compiler knows. */
DAHL_INLINE void run_counts(const job_t *job)
{
    if (job->count == CHUNK) {
        run(job, CHUNK, read_count);
    } else {
        run(job, job->count, read_count);
    }
}

DAHL_INLINE void run_angles(const job_t *job)
{
    if (job->count == CHUNK) {
        run(job, CHUNK, read_angle);
    } else {
        run(job, job->count, read_angle);
    }
}

DAHL_VARIANTS(counts, job_t, run_counts)
DAHL_VARIANTS(angles, job_t, run_angles)

static dahl_err_t check_all(const dahl_throughput_params_t *params, size_t channels, int by_counts)
{
    dahl_throughput_scale_t scale;
    dahl_err_t err = DAHL_OK;
    for (size_t c = 0; c < channels && err == DAHL_OK; c++) {
        err = dahl_throughput_check(&params[c], by_counts, &scale);
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
    for (size_t first = 0; first < all->count && err == DAHL_OK; first += CHUNK) {
        job_t job = chunk_of(all, first);
        run_chunk(&job);
    }
    return err;
}

dahl_err_t dahl_throughput_counts_channels(const dahl_throughput_params_t *params, dahl_state_t *states, size_t channels,
                                           const int32_t *dcounts, float *F, size_t n)
{
    job_t all = {params, states, dcounts, F, channels, channels, n, 1};
    return run_all(&all, counts);
}

dahl_err_t dahl_throughput_channels(const dahl_throughput_params_t *params, dahl_state_t *states, size_t channels,
                                    const float *dtheta, float *F, size_t n)
{
    job_t all = {params, states, dtheta, F, channels, channels, n, 0};
    return run_all(&all, angles);
}

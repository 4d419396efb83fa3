/* SPDX-License-Identifier: MIT */
/*
 * Many channels side by side, bit for bit as single steps. A row of short moves is a gathering of table entries and then
 * one tick for a vector of channels; a row with a long move goes channel by channel.
 */
#include "batch.h"
#include "batch_targets.h"

#define CHUNK 16 /* channels at a time */

typedef struct {
    int64_t w[CHUNK];
    uint32_t size[CHUNK], backward[CHUNK], hi[CHUNK], lo[CHUNK];
    double unit[CHUNK];
} chunk_t;

typedef struct {
    const dahl_plan_t *plans;
    dahl_state_t *states;
    const int32_t *dcounts; /* of the first channel of the chunk */
    float *F;
    size_t count, stride, n;
} job_t;

/* Takes the moves of a row apart; returns whether all are short. */
DAHL_INLINE int take_row(chunk_t *chunk, size_t count, const int32_t *dcounts)
{
    uint32_t most = 0;
    DAHL_AS_VECTORS
    for (size_t c = 0; c < count; c++) {
        chunk->backward[c] = (uint32_t)0 - (uint32_t)(dcounts[c] < 0);
        chunk->size[c] = dahl_batch_size(dcounts[c], chunk->backward[c]);
        most = chunk->size[c] > most ? chunk->size[c] : most;
    }
    return most <= DAHL_DENSE;
}

DAHL_INLINE void near_row(chunk_t *chunk, size_t count, const dahl_plan_t *plans)
{
    for (size_t c = 0; c < count; c++) {
        chunk->hi[c] = plans[c].g[chunk->size[c]].hi;
        chunk->lo[c] = plans[c].g[chunk->size[c]].lo;
    }
    DAHL_AS_VECTORS
    for (size_t c = 0; c < count; c++) {
        dahl_q64_t g = {chunk->hi[c], chunk->lo[c]};
        chunk->w[c] = (int64_t)dahl_batch_near((uint64_t)chunk->w[c], g, chunk->backward[c]);
    }
}

DAHL_INLINE void far_row(chunk_t *chunk, size_t count, const dahl_plan_t *plans, const int32_t *dcounts)
{
    for (size_t c = 0; c < count; c++) {
        dahl_state_t state = {chunk->w[c]};
        dahl_batch_move(&plans[c], &state, dcounts[c]);
        chunk->w[c] = state.w;
    }
}

DAHL_INLINE void torque_row(const chunk_t *chunk, size_t count, const dahl_plan_t *plans, float *F)
{
    uint64_t close = 0;
    DAHL_AS_VECTORS
    for (size_t c = 0; c < count; c++) {
        dahl_double_t torque = dahl_batch_product(chunk->w[c], chunk->unit[c]);
        F[c] = (float)torque.value;
        close |= (uint64_t)dahl_batch_is_close(torque);
    }
    for (size_t c = 0; c < count && close != 0; c++) {
        F[c] = dahl_torque_of(&plans[c], chunk->w[c]);
    }
}

DAHL_INLINE void run_count(const job_t *job, size_t count)
{
    chunk_t chunk;
    for (size_t c = 0; c < count; c++) {
        chunk.unit[c] = dahl_batch_unit(&job->plans[c]);
        chunk.w[c] = job->states[c].w;
    }
    for (size_t t = 0; t < job->n; t++) {
        const int32_t *dcounts = job->dcounts + t * job->stride;
        if (take_row(&chunk, count, dcounts)) {
            near_row(&chunk, count, job->plans);
        } else {
            far_row(&chunk, count, job->plans, dcounts);
        }
        torque_row(&chunk, count, job->plans, job->F + t * job->stride);
    }
    for (size_t c = 0; c < count; c++) {
        job->states[c].w = chunk.w[c];
    }
}

/* A whole chunk has a number of channels that the compiler knows. */
DAHL_INLINE void run(const job_t *job)
{
    if (job->count == CHUNK) {
        run_count(job, CHUNK);
    } else {
        run_count(job, job->count);
    }
}

DAHL_VARIANTS(run_chunk, job_t, run)

void dahl_batch_counts_channels(const dahl_plan_t *plans, dahl_state_t *states, size_t channels, const int32_t *dcounts,
                                float *F, size_t n)
{
    for (size_t first = 0; n != 0 && first < channels; first += CHUNK) {
        size_t count = channels - first < CHUNK ? channels - first : CHUNK;
        job_t job = {plans + first, states + first, dcounts + first, F + first, count, channels, n};
        run_chunk(&job);
    }
}

void dahl_batch_channels(const dahl_plan_t *plans, dahl_state_t *states, size_t channels, const float *dtheta, float *F, size_t n)
{
    for (size_t i = 0; i < n * channels; i++) {
        F[i] = dahl_step(&plans[i % channels], &states[i % channels], dtheta[i]);
    }
}

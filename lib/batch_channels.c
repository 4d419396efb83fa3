/* SPDX-License-Identifier: MIT */
/*
 * Many channels side by side, bit for bit as single steps. For a few rows of ticks all table entries are gathered first: that
 * of the low digit, and one for each further binary digit that the longest move has; a digit that is not set takes entry 0,
 * which changes nothing. Then the rows go one after the other, each a vector of channels. Rows with moves of more digits than
 * there is room for go channel by channel.
 */
#include "batch.h"
#include "batch_targets.h"

#define CHUNK 16 /* channels at a time */

#define ROWS 8
#define DIGITS 5 /* moves below 128 counts */

typedef struct {
    int64_t w[CHUNK];
    double unit[CHUNK];
    uint32_t size[ROWS][CHUNK], backward[ROWS][CHUNK];
    dahl_q64_t g[DIGITS][ROWS][CHUNK];
} chunk_t;

typedef struct {
    const dahl_plan_t *plans;
    dahl_state_t *states;
    const int32_t *dcounts; /* of the first channel of the chunk */
    float *F;
    size_t count, stride, n;
} job_t;

/* Takes the moves of some rows apart; returns how many digits the longest has. */
DAHL_INLINE int take_rows(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t rows)
{
    uint32_t bits = 0, over = 0; /* or, not maximum: vectors have it at half the cost */
    int digits = 1;
    for (size_t t = 0; t < rows; t++) {
        const int32_t *dcounts = job->dcounts + (first + t) * job->stride;
        DAHL_AS_VECTORS
        for (size_t c = 0; c < count; c++) {
            uint32_t backward = (uint32_t)0 - (uint32_t)(dcounts[c] < 0), size = dahl_batch_size(dcounts[c], backward);
            chunk->backward[t][c] = backward;
            chunk->size[t][c] = size;
            bits |= size;
            over |= (size + DAHL_DENSE - 1u) / (2u * DAHL_DENSE); /* 0 up to 8 counts */
        }
    }
    for (bits = over != 0 ? bits / DAHL_DENSE : 0u; bits != 0; bits >>= 1) {
        digits++;
    }
    return digits;
}

DAHL_INLINE uint32_t entry_of(uint32_t size, int digit)
{
    if (digit == 0) {
        return size > DAHL_DENSE ? size % DAHL_DENSE : size;
    }
    return size > DAHL_DENSE && (size / DAHL_DENSE >> (digit - 1) & 1u) ? DAHL_DENSE + (uint32_t)digit - 1u : 0u;
}

DAHL_INLINE void gather_short(chunk_t *chunk, const dahl_plan_t *plans, size_t count, size_t rows)
{
    for (size_t t = 0; t < rows; t++) {
        for (size_t c = 0; c < count; c++) {
            chunk->g[0][t][c] = plans[c].g[chunk->size[t][c]];
        }
    }
}

DAHL_INLINE void gather(chunk_t *chunk, const dahl_plan_t *plans, size_t count, size_t rows, int digits)
{
    for (int k = 0; k < digits; k++) {
        for (size_t t = 0; t < rows; t++) {
            for (size_t c = 0; c < count; c++) {
                chunk->g[k][t][c] = plans[c].g[entry_of(chunk->size[t][c], k)];
            }
        }
    }
}

DAHL_INLINE void near_row(chunk_t *chunk, size_t count, size_t t, int digits)
{
    for (int k = 0; k < digits; k++) {
        DAHL_AS_VECTORS
        for (size_t c = 0; c < count; c++) {
            chunk->w[c] = (int64_t)dahl_batch_near((uint64_t)chunk->w[c], chunk->g[k][t][c], chunk->backward[t][c]);
        }
    }
}

DAHL_INLINE void far_row(chunk_t *chunk, const job_t *job, size_t count, size_t t)
{
    for (size_t c = 0; c < count; c++) {
        dahl_state_t state = {chunk->w[c]};
        dahl_batch_move(&job->plans[c], &state, job->dcounts[t * job->stride + c]);
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
        F[c] = dahl_torque_of(&plans[c], (uint64_t)chunk->w[c]);
    }
}

DAHL_INLINE void run_rows(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t rows)
{
    int digits = take_rows(chunk, job, count, first, rows);
    if (digits == 1) {
        gather_short(chunk, job->plans, count, rows);
    } else if (digits <= DIGITS) {
        gather(chunk, job->plans, count, rows, digits);
    }
    for (size_t t = 0; t < rows; t++) {
        if (digits <= DIGITS) {
            near_row(chunk, count, t, digits);
        } else {
            far_row(chunk, job, count, first + t);
        }
        torque_row(chunk, count, job->plans, job->F + (first + t) * job->stride);
    }
}

DAHL_INLINE void run_count(const job_t *job, size_t count)
{
    chunk_t chunk;
    for (size_t c = 0; c < count; c++) {
        chunk.unit[c] = dahl_batch_unit(&job->plans[c]);
        chunk.w[c] = job->states[c].w;
    }
    for (size_t t = 0; t < job->n; t += ROWS) {
        run_rows(&chunk, job, count, t, job->n - t < ROWS ? job->n - t : ROWS);
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

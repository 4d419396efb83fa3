/* SPDX-License-Identifier: MIT */
/** Many channels with the bits of single steps. For a few rows of ticks, the table entries of the low digits are
 * gathered first. The entries of the other digits are stored by channel at the start. Each row is then a vector of
 * channels and moves digit by digit; g = 0 for a digit that is not set. */
#include "exact.h"

#ifdef DAHL_AVX512
#include <immintrin.h>
#endif

#define CHUNK 16  /* channels, and ticks, at a time */
#define DIGITS 29 /* number of digits of a move, in units of 8 counts */
#define DIRECT (DAHL_DIRECT_COUNTS_MAX + 1u) /* entries for moves without further digits */

typedef struct {
    int64_t w[CHUNK % 16 == 0 ? CHUNK : -1]; /* whole vectors of floats, for the widest vectors */
    double unit[CHUNK];
    uint64_t digit[DIGITS][CHUNK]; /* entries as in pair() */
    uint64_t backward[CHUNK][CHUNK], g[CHUNK][CHUNK];
    uint32_t low[CHUNK][CHUNK], eights[CHUNK][CHUNK];
    bool is_uniform; /* a full chunk of channels with equal entries: one encoder, one sigma0/Fc */
} chunk_t;

typedef struct {
    const dahl_plan_t *plans;
    dahl_state_t *states;
    const int32_t *dcounts; /* moves of the first channel of the chunk */
    float *F;
    size_t count, stride, n;
} job_t;

/** Split the moves of some rows. Return the OR of all digits above the low one. */
DAHL_INLINE uint32_t split_rows(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t rows)
{
    uint32_t digits = 0;
    for (size_t t = 0; t < rows; t++) {
        const int32_t *dcounts = job->dcounts + (first + t) * job->stride;
        DAHL_AS_VECTORS
        for (size_t c = 0; c < count; c++) {
            uint32_t size = dahl_batch_size(dcounts[c]);
            uint32_t eights = size == DAHL_DIRECT_COUNTS_MAX ? 0u : size / DAHL_DIRECT_COUNTS_MAX;
            chunk->backward[t][c] = dahl_batch_direction(dcounts[c]);
            chunk->low[t][c] = size - eights * DAHL_DIRECT_COUNTS_MAX;
            chunk->eights[t][c] = eights;
            digits |= eights;
        }
    }
    return digits;
}

/** Return an entry in one word. On a little-endian core, this order is a plain load. */
DAHL_INLINE uint64_t pair(dahl_q64_t g)
{
    return ((uint64_t)g.lo << 32) + g.hi;
}

typedef void (*gather_t)(chunk_t *chunk, const dahl_plan_t *plans, size_t count, size_t rows);

DAHL_INLINE void gather(chunk_t *chunk, const dahl_plan_t *plans, size_t count, size_t rows)
{
    for (size_t t = 0; t < rows; t++) {
        for (size_t c = 0; c < count; c++) {
            chunk->g[t][c] = pair(plans[c].g[chunk->low[t][c]]);
        }
    }
}

#ifdef DAHL_AVX512
/** Gather from two registers, if all channels have the entries of the first one. */
DAHL_AVX512 DAHL_INLINE void gather_from_registers(chunk_t *chunk, const dahl_plan_t *plans, size_t count, size_t rows)
{
    uint64_t entries[16] = {0};
    if (!chunk->is_uniform) {
        gather(chunk, plans, count, rows);
        return;
    }
    for (size_t n = 0; n < DIRECT; n++) {
        entries[n] = pair(plans[0].g[n]);
    }
    const __m512i first = _mm512_loadu_si512(entries), last = _mm512_loadu_si512(entries + 8);
    for (size_t t = 0; t < rows; t++) {
        for (size_t c = 0; c < CHUNK; c += 8) {
            __m512i low = _mm512_cvtepu32_epi64(_mm256_loadu_si256((const __m256i *)(const void *)&chunk->low[t][c]));
            _mm512_storeu_si512(&chunk->g[t][c], _mm512_permutex2var_epi64(first, low, last));
        }
    }
}
#endif

/** The same as dahl_forward(), with operations that vectors have. */
DAHL_INLINE int64_t step(int64_t w, uint64_t backward, uint64_t g)
{
    uint64_t v = (uint64_t)w ^ backward, z = dahl_batch_gap(v) >> 32;
    return (int64_t)((v + (z * (g & UINT32_MAX) + (z * (g >> 32) >> 32))) ^ backward);
}

DAHL_INLINE void move_low_digit(chunk_t *chunk, size_t count, size_t t)
{
    DAHL_AS_VECTORS
    for (size_t c = 0; c < count; c++) {
        chunk->w[c] = step(chunk->w[c], chunk->backward[t][c], chunk->g[t][c]);
    }
}

DAHL_INLINE void move_digit(chunk_t *chunk, size_t count, size_t t, uint32_t digit)
{
    const uint64_t *entries = chunk->digit[31u - dahl_leading_zeros(digit)];
    DAHL_AS_VECTORS
    for (size_t c = 0; c < count; c++) {
        uint64_t g = (chunk->eights[t][c] & digit) != 0 ? entries[c] : 0u;
        chunk->w[c] = step(chunk->w[c], chunk->backward[t][c], g);
    }
}

/** Return the digits that can change a bit: those of channels with a remaining gap. */
DAHL_INLINE uint32_t active_digits(const chunk_t *chunk, size_t count, size_t t)
{
    uint64_t active = 0;
    DAHL_AS_VECTORS
    for (size_t c = 0; c < count; c++) {
        uint64_t gap = dahl_batch_gap((uint64_t)chunk->w[c] ^ chunk->backward[t][c]) >> 32;
        active |= gap != 0 ? chunk->eights[t][c] : 0u;
    }
    return (uint32_t)active;
}

/** After every third digit, drop the digits that cannot change a bit. */
DAHL_INLINE void move_row(chunk_t *chunk, size_t count, size_t t, uint32_t digits)
{
    move_low_digit(chunk, count, t);
    for (uint32_t rest = digits; rest != 0;) {
        uint32_t digit = rest & (0u - rest);
        move_digit(chunk, count, t, digit);
        rest &= rest - 1u;
        if ((digit & 0x24924924u) != 0) {
            rest &= active_digits(chunk, count, t);
        }
    }
}

DAHL_INLINE void run_rows(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t rows, bool converts,
                          gather_t entries)
{
    uint32_t digits = split_rows(chunk, job, count, first, rows);
    entries(chunk, job->plans, count, rows);
    for (size_t t = 0; t < rows; t++) {
        move_row(chunk, count, t, digits);
        dahl_batch_torques(job->plans, chunk->unit, 1, chunk->w, job->F + (first + t) * job->stride, count, converts);
    }
}

DAHL_INLINE void start(chunk_t *chunk, const job_t *job, size_t count)
{
    chunk->is_uniform = count == CHUNK;
    for (size_t c = 0; c < count; c++) {
        chunk->unit[c] = dahl_batch_unit(&job->plans[c]);
        chunk->w[c] = (int64_t)dahl_clamp((uint64_t)job->states[c].w);
        for (size_t n = 0; n < DIRECT; n++) {
            chunk->is_uniform = chunk->is_uniform && pair(job->plans[c].g[n]) == pair(job->plans[0].g[n]);
        }
        for (int k = 0; k < DIGITS; k++) {
            chunk->digit[k][c] = pair(job->plans[c].g[DAHL_DIRECT_COUNTS_MAX + k]);
        }
    }
}

DAHL_INLINE void run_count(const job_t *job, size_t count, bool converts, gather_t entries)
{
    chunk_t chunk;
    start(&chunk, job, count);
    size_t rows;
    for (size_t t = 0; t < job->n; t += rows) {
        rows = job->n - t < CHUNK ? job->n - t : CHUNK;
        run_rows(&chunk, job, count, t, rows, converts, entries);
    }
    for (size_t c = 0; c < count; c++) {
        job->states[c].w = chunk.w[c];
    }
}

/** A full chunk passes a constant number of channels to the compiler. */
DAHL_INLINE void run(const job_t *job, bool converts, gather_t entries)
{
    if (job->count == CHUNK) {
        run_count(job, CHUNK, converts, entries);
    } else {
        run_count(job, job->count, converts, entries);
    }
}

DAHL_VARIANTS_OF(run_chunk, job_t, run(job, true, gather_from_registers), run(job, false, gather), run(job, true, gather))

void dahl_batch_counts_channels(const dahl_plan_t *plans, dahl_state_t *states, size_t channels, const int32_t *dcounts,
                                float *F, size_t n)
{
    for (size_t first = 0; n != 0 && first < channels; first += CHUNK) {
        size_t count = channels - first < CHUNK ? channels - first : CHUNK;
        job_t job = {plans + first, states + first, dcounts + first, F + first, count, channels, n};
        run_chunk(&job);
    }
}

void dahl_batch_channels(const dahl_plan_t *plans, dahl_state_t *states, size_t channels, const float *dtheta, float *F,
                         size_t n)
{
    for (size_t i = 0; i < n * channels; i++) {
        F[i] = dahl_step(&plans[i % channels], &states[i % channels], dtheta[i]);
    }
}

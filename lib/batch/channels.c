/* SPDX-License-Identifier: MIT */
/** Many channels: vectors run across the channels, so only the ticks are serial. A block of ticks computes only d =
 * w - w0, which is then carried into the state. If the channels have equal travel per count and the core has
 * AVX-512, g of few counts comes from a table in registers (wide.h). */
#include <stddef.h>
#include <string.h>

#include "wide.h"

#define CHUNK 16  /* channels at a time */
#define BLOCK 128 /* ticks before d is carried into the state */

typedef struct {
    double a[CHUNK], Fc[CHUNK], w0[CHUNK], F0[CHUNK], d[CHUNK];
    uint32_t small, tiny;             /* least values of all channels */
    double table[DAHL_TABLE_ENTRIES]; /* g of 0 .. table_most counts, equal for all channels */
    uint32_t table_most;              /* 0: no table */
} chunk_t;

typedef struct {
    const dahl_throughput_params_t *params;
    dahl_state_t *states;
    const void *moves; /* int32_t or float; moves of the first channel of the chunk */
    float *F;
    size_t count, stride, n;
    bool by_counts;
} job_t;

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
            F[c] = (float)(chunk->Fc[c] * d + chunk->F0[c]);
        }
    }
}

typedef void (*steps_t)(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last);

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

#ifdef DAHL_AVX512
typedef struct {
    __m512d w0, Fc, F0, d;
} eight_t;

DAHL_WIDE eight_t load_eight(const chunk_t *chunk, size_t from)
{
    eight_t r = {_mm512_loadu_pd(chunk->w0 + from), _mm512_loadu_pd(chunk->Fc + from), _mm512_loadu_pd(chunk->F0 + from),
                 _mm512_loadu_pd(chunk->d + from)};
    return r;
}

DAHL_WIDE __m256 step_eight(eight_t *eight, const __m512d table[2], __m256i moves)
{
    __m512i counts = _mm512_cvtepi32_epi64(moves);
    dahl_wide_g_t g = {dahl_wide_look_up(table, _mm512_abs_epi64(counts)), counts};
    __m512d c = dahl_wide_with_sign(g) - eight->w0 * g.size;
    eight->d = (1.0 - g.size) * eight->d + c;
    return _mm512_cvtpd_ps(eight->Fc * eight->d + eight->F0);
}

DAHL_WIDE void step_by_table(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last)
{
    const __m512d table[2] = {_mm512_loadu_pd(chunk->table), _mm512_loadu_pd(chunk->table + 8)};
    const __mmask8 used = (__mmask8)((1u << count) - 1u), more = (__mmask8)(((1u << count) - 1u) >> 8);
    const size_t stride = job->stride;
    const int32_t *moves = (const int32_t *)job->moves + first * stride;
    float *F = job->F + first * stride;
    eight_t low = load_eight(chunk, 0), high = load_eight(chunk, 8);
    for (size_t t = first; t < last; t++) {
        if (count == CHUNK) {
        _mm256_storeu_ps(F, step_eight(&low, table, _mm256_loadu_si256((const void*)moves)));
        _mm256_storeu_ps(F + 8, step_eight(&high, table, _mm256_loadu_si256((const void*)(moves+8))));
        } else {
        _mm256_mask_storeu_ps(F, used, step_eight(&low, table, _mm256_maskz_loadu_epi32(used, moves)));
        _mm256_mask_storeu_ps(F + 8, more, step_eight(&high, table, _mm256_maskz_loadu_epi32(more, moves + 8)));
        }
        moves += stride;
        F += stride;
    }
    _mm512_storeu_pd(chunk->d, low.d);
    _mm512_storeu_pd(chunk->d + 8, high.d);
}

/** Make the table if all channels have the same travel per count. */
DAHL_INLINE void make_table(chunk_t *chunk, size_t count)
{
    double a = chunk->a[0];
    chunk->table_most = DAHL_TABLE_MOST;
    for (size_t c = 0; c < count; c++) {
        chunk->table_most = a < chunk->a[c] || a > chunk->a[c] ? 0 : chunk->table_most;
    }
    for (uint32_t n = 0; n <= chunk->table_most; n++) {
        chunk->table[n] = dahl_g_any(a * n);
    }
}

DAHL_WIDE void step_few_counts(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last)
{
    if (first == 0 && last >= 16) { /* enough ticks to pay for the table */
        make_table(chunk, count);
    }
    uint32_t most = largest(job, first, last, dahl_measure_of_count);
    if (chunk->table_most != 0 && most <= chunk->table_most) {
        step_by_table(chunk, job, count, first, last);
    } else {
        step_up_to(most, chunk, job, count, first, last, dahl_value_of_count, dahl_value_of_count);
    }
}
#endif

DAHL_INLINE void run_block(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last, steps_t steps)
{
    for (size_t c = 0; c < count; c++) {
        chunk->w0[c] = dahl_w_of(&job->states[c]);
        chunk->F0[c] = chunk->Fc[c] * chunk->w0[c];
        chunk->d[c] = 0.0;
    }
    steps(chunk, job, count, first, last);
    for (size_t c = 0; c < count; c++) {
        dahl_carry(&job->states[c], chunk->d[c]);
    }
}

DAHL_INLINE void read_params(chunk_t *chunk, const job_t *job, size_t count)
{
    (void)memset(chunk, 0, sizeof *chunk);
    chunk->small = chunk->tiny = UINT32_MAX;
    for (size_t c = 0; c < count; c++) {
        dahl_throughput_scale_t scale;
        (void)dahl_throughput_check(&job->params[c], job->by_counts, &scale);
        chunk->a[c] = scale.a;
        chunk->Fc[c] = scale.Fc;
        chunk->small = scale.small < chunk->small ? scale.small : chunk->small;
        chunk->tiny = scale.tiny < chunk->tiny ? scale.tiny : chunk->tiny;
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

DAHL_VARIANTS(counts, job_t, run_by_size(job, step_few_counts), run_by_size(job, step_counts), run_by_size(job, step_counts))
DAHL_VARIANTS(angles, job_t, run_by_size(job, step_angles), run_by_size(job, step_angles), run_by_size(job, step_angles))

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
    job_t all = {params, states, dcounts, F, channels, channels, n, true};
    return run_all(&all, counts);
}

dahl_err_t dahl_throughput_channels(const dahl_throughput_params_t *params, dahl_state_t *states, size_t channels,
                                    const float *dtheta, float *F, size_t n)
{
    job_t all = {params, states, dtheta, F, channels, channels, n, false};
    return run_all(&all, angles);
}

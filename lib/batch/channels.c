/* SPDX-License-Identifier: MIT */
/** Many channels: vectors run across the channels, so only the ticks are serial. A block of ticks computes only d =
 * w - w0, which is then carried into the state. With AVX-512 d stays in registers, and if the channels have equal travel
 * per count, g of few counts comes from a table (wide.h). */
#include <stddef.h>
#include <string.h>

#include "wide.h"

#define CHUNK 16  /* channels at a time */
#define BLOCK 128 /* ticks before d is carried into the state */

typedef struct {
    double a[CHUNK], Fc[CHUNK], w0[CHUNK], F0[CHUNK], d[CHUNK];
    double least_a;
    uint32_t small, tiny; /* least values of all channels */
    bool is_uniform;      /* all have one a and one Fc */
} chunk_t;

typedef struct {
    const dahl_throughput_params_t *params;
    dahl_state_t *states;
    const void *moves; /* int32_t or float; moves of the first channel of the chunk */
    float *F;
    size_t count, stride, n;
    bool by_counts;
    const void *table; /* of short moves of the first channel, for wide.h */
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
#define TURNS 4 /* ticks of which the moves are read in turns: the latency of one exceeds the look-ahead of a processor */

/** Eight channels in registers. The state is d, or the torque in the absolute form. */
typedef struct {
    __m512d a, w0, Fc, F0, state;
    const dahl_wide_table_t *table;
    __mmask8 used;
    bool is_masked; /* a store with a mask is slower */
} eight_t;

/** Returns the moves of a tick as numbers. */
typedef __m512d (*values_t)(__m256i moves);

DAHL_WIDE __m512d counts_of(__m256i moves)
{
    return _mm512_cvtepi32_pd(moves);
}

DAHL_WIDE __m512d angles_of(__m256i moves)
{
    return _mm512_cvtps_pd(_mm256_castsi256_ps(moves));
}

DAHL_WIDE __m512d angles_or_nan_of(__m256i moves)
{
    return dahl_wide_number(angles_of(moves));
}

/** Returns maps of the torque from the moves of a tick. */
typedef dahl_map_t (*map_of_eight_t)(const eight_t *eight, __m256i moves);

DAHL_WIDE dahl_map_t map_of_counts(const eight_t *eight, __m256i moves)
{
    return dahl_wide_look_up(eight->table->counts, _mm512_cvtepi32_epi64(moves));
}

DAHL_WIDE dahl_map_t map_of_sizes(const eight_t *eight, __m256i moves)
{
    __m512i counts = _mm512_cvtepi32_epi64(moves);
    dahl_map_t map = dahl_wide_look_up(eight->table->sizes, _mm512_abs_epi64(counts));
    map.c = dahl_wide_with_sign(map.c, counts);
    return map;
}

DAHL_WIDE dahl_map_t map_of_any_counts(const eight_t *eight, __m256i moves)
{
    __m512d x = counts_of(moves), e = dahl_wide_e(_mm512_abs_pd(x) * (eight->a * DAHL_ROOTS_OF_E));
    __m512d Fc = dahl_wide_with_sign(eight->Fc, _mm512_castpd_si512(x));
    dahl_map_t map = {e, Fc - Fc * e};
    return map;
}

/** What moves a block of ticks: maps of the torque, or a kernel. */
typedef struct {
    map_of_eight_t map_of;
    values_t values_of;
    dahl_wide_kernel_t kernel;
    const dahl_wide_table_t *table;
} form_t;

DAHL_WIDE __m512d first_state(const chunk_t *chunk, size_t from, const form_t *form)
{
    __m512d zero = _mm512_setzero_pd();
    return form->map_of != NULL ? _mm512_loadu_pd(chunk->F0 + from) : zero;
}

DAHL_WIDE eight_t load_eight(const chunk_t *chunk, size_t count, size_t from, const form_t *form)
{
    eight_t eight = {_mm512_loadu_pd(chunk->a + from),
                     _mm512_loadu_pd(chunk->w0 + from),
                     _mm512_loadu_pd(chunk->Fc + from),
                     _mm512_loadu_pd(chunk->F0 + from),
                     first_state(chunk, from, form),
                     form->table,
                     (__mmask8)(((1u << count) - 1u) >> from),
                     count != CHUNK};
    return eight;
}

DAHL_WIDE __m256i load_moves(const eight_t *eight, const int32_t *moves)
{
    return eight->is_masked ? _mm256_maskz_loadu_epi32(eight->used, moves) : _mm256_loadu_si256((const void *)moves);
}

/** The map of a tick, or g and g with signs for d -> d + (c - w e), which rounds less. */
DAHL_WIDE dahl_map_t read_eight(const eight_t *eight, const form_t *form, const int32_t *moves)
{
    __m256i read = load_moves(eight, moves);
    if (form->map_of != NULL) {
        return form->map_of(eight, read);
    }
    __m512d x = form->values_of(read), g = form->kernel(_mm512_abs_pd(x) * eight->a);
    dahl_map_t g_and_sign = {g, dahl_wide_with_sign(g, _mm512_castpd_si512(x))};
    return g_and_sign;
}

DAHL_WIDE void move_eight(eight_t *eight, const form_t *form, dahl_map_t move, float *F)
{
    __m512d torque;
    if (form->map_of != NULL) {
        torque = eight->state = move.e * eight->state + move.c;
    } else {
        __m512d w = eight->w0 + eight->state;
        eight->state += move.c - w * move.e;
        torque = eight->Fc * eight->state + eight->F0;
    }
    __m256 torques = _mm512_cvtpd_ps(torque);
    if (eight->is_masked) {
        _mm256_mask_storeu_ps(F, eight->used, torques);
    } else {
        _mm256_storeu_ps(F, torques);
    }
}

DAHL_WIDE void step_turns(eight_t eights[2], const int32_t *moves, float *F, size_t stride, int turns, const form_t *form)
{
    dahl_map_t move[TURNS][2];
    DAHL_UNROLL_8
    for (int t = 0; t < turns; t++) {
        DAHL_UNROLL_8
        for (int i = 0; i < 2; i++) {
            move[t][i] = read_eight(&eights[i], form, moves + (size_t)t * stride + 8 * i);
        }
    }
    DAHL_UNROLL_8
    for (int t = 0; t < turns; t++) {
        DAHL_UNROLL_8
        for (int i = 0; i < 2; i++) {
            move_eight(&eights[i], form, move[t][i], F + (size_t)t * stride + 8 * i);
        }
    }
}

DAHL_WIDE void step_wide(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last, form_t form)
{
    const size_t stride = job->stride;
    const int32_t *moves = (const int32_t *)job->moves;
    float *F = job->F;
    eight_t eights[2] = {load_eight(chunk, count, 0, &form), load_eight(chunk, count, 8, &form)};
    size_t t = first;
    for (; t + TURNS <= last; t += TURNS) {
        step_turns(eights, moves + t * stride, F + t * stride, stride, TURNS, &form);
    }
    for (; t < last; t++) {
        step_turns(eights, moves + t * stride, F + t * stride, stride, 1, &form);
    }
    for (size_t i = 0; i < 2; i++) { /* the motion of w */
        __m512d moved = eights[i].state - first_state(chunk, 8 * i, &form);
        if (form.map_of != NULL) {
            moved = _mm512_maskz_div_pd(eights[i].used, moved, eights[i].Fc);
        }
        _mm512_storeu_pd(chunk->d + 8 * i, moved);
    }
}

DAHL_WIDE uint32_t largest_wide(const job_t *job, size_t first, size_t last, dahl_wide_measure_t measure)
{
    const int32_t *moves = (const int32_t *)job->moves + first * job->stride;
    uint32_t most = 0;
    if (job->stride == job->count) {
        return dahl_wide_largest(moves, (last - first) * job->count, measure);
    }
    for (size_t t = first; t < last; t++) {
        uint32_t size = dahl_wide_largest(moves, job->count, measure);
        most = size > most ? size : most;
        moves += job->stride;
    }
    return most;
}

DAHL_WIDE form_t form_of_kernel(values_t values_of, dahl_wide_kernel_t kernel)
{
    form_t form = {NULL, values_of, kernel, NULL};
    return form;
}

DAHL_WIDE form_t form_of_maps(map_of_eight_t map_of, const dahl_wide_table_t *table)
{
    form_t form = {map_of, NULL, NULL, table};
    return form;
}

DAHL_WIDE void step_wide_counts(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last)
{
    const uint32_t most = largest_wide(job, first, last, dahl_wide_counts);
    const bool is_absolute = chunk->least_a >= DAHL_ABSOLUTE_LEAST;
    const dahl_wide_table_t *table = is_absolute && chunk->is_uniform ? job->table : NULL;
    if (table != NULL && most <= DAHL_COUNTS_MOST) {
        step_wide(chunk, job, count, first, last, form_of_maps(map_of_counts, table));
    } else if (table != NULL && most <= DAHL_SIZES_MOST) {
        step_wide(chunk, job, count, first, last, form_of_maps(map_of_sizes, table));
    } else if (most <= chunk->tiny) {
        step_wide(chunk, job, count, first, last, form_of_kernel(counts_of, dahl_wide_tiny));
    } else if (most <= chunk->small) {
        step_wide(chunk, job, count, first, last, form_of_kernel(counts_of, dahl_wide_small));
    } else if (is_absolute) {
        step_wide(chunk, job, count, first, last, form_of_maps(map_of_any_counts, NULL));
    } else {
        step_wide(chunk, job, count, first, last, form_of_kernel(counts_of, dahl_wide_any));
    }
}

DAHL_WIDE void step_wide_angles(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last)
{
    const uint32_t most = largest_wide(job, first, last, dahl_wide_angles);
    if (most <= chunk->tiny) {
        step_wide(chunk, job, count, first, last, form_of_kernel(angles_of, dahl_wide_tiny));
    } else if (most <= chunk->small) {
        step_wide(chunk, job, count, first, last, form_of_kernel(angles_of, dahl_wide_small));
    } else {
        step_wide(chunk, job, count, first, last, form_of_kernel(angles_or_nan_of, dahl_wide_any));
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
        with_table.table = &table;
    }
    run_by_size(&with_table, step_wide_counts);
}
#endif

DAHL_VARIANTS(counts, job_t, run_wide_counts(job), run_by_size(job, step_counts), run_by_size(job, step_counts))
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
    job_t all = {params, states, dcounts, F, channels, channels, n, true, NULL};
    return run_all(&all, counts);
}

dahl_err_t dahl_throughput_channels(const dahl_throughput_params_t *params, dahl_state_t *states, size_t channels,
                                    const float *dtheta, float *F, size_t n)
{
    job_t all = {params, states, dtheta, F, channels, channels, n, false, NULL};
    return run_all(&all, angles);
}

/* SPDX-License-Identifier: MIT */
/** Channels in AVX-512 registers, eight in each: maps of W from tables or powers, or polynomials (wide.h). */
#ifndef DAHL_BATCH_CHANNELS_WIDE_H
#define DAHL_BATCH_CHANNELS_WIDE_H

#include "channels.h"
#include "wide.h"

#ifdef DAHL_AVX512

#define TURNS 4 /* ticks of which the moves are read in turns: the latency of one exceeds the look-ahead of a processor */

/** Eight channels in registers. The state is d, or W in the absolute form. */
typedef struct {
    __m512d a, w0, Fc, W0, state;
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

/** Returns maps of W from the moves of a tick. */
typedef dahl_eight_maps_t (*map_of_eight_t)(const eight_t *eight, __m256i moves);

DAHL_WIDE dahl_eight_maps_t map_of_counts(const eight_t *eight, __m256i moves)
{
    return dahl_wide_look_up(eight->table->counts, _mm512_cvtepi32_epi64(moves));
}

DAHL_WIDE dahl_eight_maps_t map_of_sizes(const eight_t *eight, __m256i moves)
{
    __m512i counts = _mm512_cvtepi32_epi64(moves);
    dahl_eight_maps_t map = dahl_wide_look_up(eight->table->sizes, _mm512_abs_epi64(counts));
    map.c = dahl_wide_with_sign(map.c, counts);
    return map;
}

DAHL_WIDE dahl_eight_maps_t map_of_any_counts(const eight_t *eight, __m256i moves)
{
    return dahl_wide_map_of_any(counts_of(moves), eight->a * DAHL_ROOTS_OF_E, eight->Fc);
}

/** How to step a block: by map_of with maps of W, else by a kernel of g. */
typedef struct {
    map_of_eight_t map_of;
    values_t values_of;
    dahl_wide_kernel_t kernel;
    const dahl_wide_table_t *table;
} form_t;

DAHL_WIDE __m512d start_of_eight(const chunk_t *chunk, size_t from, const form_t *form)
{
    __m512d zero = _mm512_setzero_pd();
    return form->map_of != NULL ? _mm512_loadu_pd(chunk->W0 + from) : zero;
}

DAHL_WIDE eight_t load_eight(const chunk_t *chunk, size_t count, size_t from, const form_t *form)
{
    eight_t eight = {_mm512_loadu_pd(chunk->a + from),
                     _mm512_loadu_pd(chunk->w0 + from),
                     _mm512_loadu_pd(chunk->Fc + from),
                     _mm512_loadu_pd(chunk->W0 + from),
                     start_of_eight(chunk, from, form),
                     form->table,
                     (__mmask8)(((1u << count) - 1u) >> from),
                     count != CHUNK};
    return eight;
}

DAHL_WIDE __m256i load_moves(const eight_t *eight, const int32_t *moves)
{
    return eight->is_masked ? _mm256_maskz_loadu_epi32(eight->used, moves) : _mm256_loadu_si256((const void *)moves);
}

/** Return the maps of a tick. For a kernel, e is g, and c is g with signs: d + (c - w e) rounds less. */
DAHL_WIDE dahl_eight_maps_t read_eight(const eight_t *eight, const form_t *form, const int32_t *moves)
{
    __m256i read = load_moves(eight, moves);
    if (form->map_of != NULL) {
        return form->map_of(eight, read);
    }
    __m512d x = form->values_of(read), g = form->kernel(_mm512_abs_pd(x) * eight->a);
    dahl_eight_maps_t g_and_sign = {g, dahl_wide_with_sign(g, _mm512_castpd_si512(x))};
    return g_and_sign;
}

DAHL_WIDE void move_eight(eight_t *eight, const form_t *form, dahl_eight_maps_t move, float *F)
{
    __m512d W;
    if (form->map_of != NULL) {
        W = eight->state = move.e * eight->state + move.c;
    } else {
        __m512d w = eight->w0 + eight->state;
        eight->state += move.c - w * move.e;
        W = eight->Fc * eight->state + eight->W0;
    }
    __m256 torques = _mm512_cvtpd_ps(W);
    if (eight->is_masked) {
        _mm256_mask_storeu_ps(F, eight->used, torques);
    } else {
        _mm256_storeu_ps(F, torques);
    }
}

DAHL_WIDE void step_turns(eight_t eights[2], const int32_t *moves, float *F, size_t stride, int turns, const form_t *form)
{
    dahl_eight_maps_t move[TURNS][2];
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
        __m512d moved = eights[i].state - start_of_eight(chunk, 8 * i, &form);
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

/** Step by maps of W. Return false if a is too small for them, or if polynomials are faster. */
DAHL_WIDE bool step_wide_maps(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last, uint32_t most)
{
    const dahl_wide_table_t *table = chunk->is_uniform ? job->wide_table : NULL;
    const bool is_short = table != NULL && most <= DAHL_SIZES_MOST;
    if (chunk->least_a < DAHL_ABSOLUTE_LEAST || (most <= chunk->small && !is_short)) {
        return false;
    }
    if (!is_short) {
        step_wide(chunk, job, count, first, last, form_of_maps(map_of_any_counts, NULL));
    } else if (most <= DAHL_COUNTS_MOST) {
        step_wide(chunk, job, count, first, last, form_of_maps(map_of_counts, table));
    } else {
        step_wide(chunk, job, count, first, last, form_of_maps(map_of_sizes, table));
    }
    return true;
}

/** Step by the kernel for moves of up to `most`. any_values_of reads moves that may be NaN. */
DAHL_WIDE void step_wide_kernels(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last, uint32_t most,
                                 values_t values_of, values_t any_values_of)
{
    if (most <= chunk->tiny) {
        step_wide(chunk, job, count, first, last, form_of_kernel(values_of, dahl_wide_tiny));
    } else if (most <= chunk->small) {
        step_wide(chunk, job, count, first, last, form_of_kernel(values_of, dahl_wide_small));
    } else {
        step_wide(chunk, job, count, first, last, form_of_kernel(any_values_of, dahl_wide_any));
    }
}

DAHL_WIDE void step_wide_counts(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last)
{
    const uint32_t most = largest_wide(job, first, last, dahl_wide_counts);
    if (!step_wide_maps(chunk, job, count, first, last, most)) {
        step_wide_kernels(chunk, job, count, first, last, most, counts_of, counts_of);
    }
}

DAHL_WIDE void step_wide_angles(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last)
{
    const uint32_t most = largest_wide(job, first, last, dahl_wide_angles);
    step_wide_kernels(chunk, job, count, first, last, most, angles_of, angles_or_nan_of);
}

#endif
#endif

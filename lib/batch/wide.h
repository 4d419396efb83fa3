/* SPDX-License-Identifier: MIT */
/**
 * g of eight moves in AVX-512 registers, for one trajectory (trajectory_tiles.h) and for channels (channels.c).
 *
 * The size of g comes from a polynomial. If all ticks have one travel per count and no move exceeds 15 counts, one
 * permutation of a table in two registers replaces it.
 */
#ifndef DAHL_BATCH_WIDE_H
#define DAHL_BATCH_WIDE_H

#include "throughput.h"

#define DAHL_TABLE_MOST 15u /* counts */

#ifdef DAHL_AVX512

#include <immintrin.h>

#define DAHL_WIDE DAHL_AVX512 DAHL_INLINE /* a function that uses 512-bit registers */
#define DAHL_NAN_CLASS 0x81               /* quiet and signalling NaN for fpclass */

/** Of eight moves: |g|, and numbers with the signs of the moves. */
typedef struct {
    __m512d size;
    __m512i sign;
} dahl_wide_g_t;

/** Returns g(u) of travels u >= 0. */
typedef __m512d (*dahl_wide_kernel_t)(__m512d u);

DAHL_WIDE __m512d dahl_wide_tiny(__m512d u)
{
    return u * DAHL_TINY_SLOPE(u);
}

DAHL_WIDE __m512d dahl_wide_small(__m512d u)
{
    return u * DAHL_SLOPE(u);
}

/** The same as dahl_g_any(). 2^-k is taken off the exponent of 1 - g, which is at least 1/2. */
DAHL_WIDE __m512d dahl_wide_any(__m512d u)
{
    __m512d most = _mm512_min_pd(u, _mm512_set1_pd(DAHL_ALL));
    __m512i k = _mm512_cvttpd_epi64(most * DAHL_LOG2E);
    __m512d r = most - _mm512_cvtepi64_pd(k) * DAHL_LN2, g = r * DAHL_SLOPE(r);
    __m512i left = _mm512_sub_epi64(_mm512_castpd_si512(1.0 - g), _mm512_slli_epi64(k, 52));
    return _mm512_mask_mov_pd(1.0 - _mm512_castsi512_pd(left), _mm512_testn_epi64_mask(k, k), g);
}

DAHL_WIDE dahl_wide_g_t dahl_wide_g(__m512d x, dahl_wide_kernel_t kernel)
{
    dahl_wide_g_t g = {kernel(_mm512_abs_pd(x)), _mm512_castpd_si512(x)};
    return g;
}

/** Replace NaN, detected by its class, by no travel. */
DAHL_WIDE __m512d dahl_wide_number(__m512d x)
{
    return _mm512_mask_mov_pd(x, _mm512_fpclass_pd_mask(x, DAHL_NAN_CLASS), _mm512_setzero_pd());
}

DAHL_WIDE __m512d dahl_wide_with_sign(dahl_wide_g_t g)
{
    const __m512i sign = _mm512_set1_epi64(INT64_MIN);
    return _mm512_or_pd(g.size, _mm512_castsi512_pd(_mm512_and_si512(g.sign, sign)));
}

/** Return g of eight moves by their counts. The permutation reads the lowest four bits of each 64-bit word. */
DAHL_WIDE __m512d dahl_wide_look_up(const __m512d table[2], __m512i counts)
{
    return _mm512_permutex2var_pd(table[0], counts, table[1]);
}

DAHL_WIDE void dahl_wide_table(double a, __m512d table[2])
{
    const __m512d counts = _mm512_setr_pd(0, 1, 2, 3, 4, 5, 6, 7);
    table[0] = dahl_wide_any(a * counts);
    table[1] = dahl_wide_any(a * (counts + 8.0));
}

/** Measure 16 moves as throughput.h does: counts without their sign, or the bits of angles without their sign. */
typedef __m512i (*dahl_wide_measure_t)(__m512i moves);

DAHL_WIDE __m512i dahl_wide_counts(__m512i moves)
{
    return _mm512_abs_epi32(moves);
}

DAHL_WIDE __m512i dahl_wide_angles(__m512i moves)
{
    return _mm512_and_si512(moves, _mm512_set1_epi32(INT32_MAX));
}

/** Return the largest measure of n moves. Two maxima take turns, since one would wait for itself. */
DAHL_WIDE uint32_t dahl_wide_largest(const void *moves, size_t n, dahl_wide_measure_t measure)
{
    const int32_t *from = moves, *end = from + n;
    __m512i one = _mm512_setzero_si512(), other = one;
    for (; end - from >= 32; from += 32) {
        one = _mm512_max_epu32(one, measure(_mm512_loadu_si512(from)));
        other = _mm512_max_epu32(other, measure(_mm512_loadu_si512(from + 16)));
    }
    for (; from < end; from += 16) {
        uint32_t used = end - from < 16 ? (1u << (end - from)) - 1u : 0xffffu;
        one = _mm512_max_epu32(one, measure(_mm512_maskz_loadu_epi32((__mmask16)used, from)));
    }
    return _mm512_reduce_max_epu32(_mm512_max_epu32(one, other));
}

#endif
#endif

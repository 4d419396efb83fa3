/* SPDX-License-Identifier: MIT */
/**
 * Eight moves in AVX-512 registers, for one trajectory (trajectory_tiles.h) and for channels (channels_wide.h): g by the
 * polynomials of throughput.h, and the maps W -> e W + c of its absolute form by tables in registers or powers of 2.
 */
#ifndef DAHL_BATCH_WIDE_H
#define DAHL_BATCH_WIDE_H

#include "throughput.h"

#ifdef DAHL_AVX512

#include <immintrin.h>

#define DAHL_WIDE DAHL_AVX512 DAHL_INLINE /* a function that uses 512-bit registers */
#define DAHL_NAN_CLASS 0x81               /* quiet and signalling NaN for fpclass */

/** Eight maps x -> e x + c, each of a tick, or of several in a row. */
typedef struct {
    __m512d e, c;
} dahl_eight_maps_t;

/** The maps `first`, then the maps `then`. */
DAHL_WIDE dahl_eight_maps_t dahl_eight_join(dahl_eight_maps_t first, dahl_eight_maps_t then)
{
    dahl_eight_maps_t both = {then.e * first.e, then.e * first.c + then.c};
    return both;
}

/** Returns g of travels u >= 0. */
typedef __m512d (*dahl_wide_kernel_t)(__m512d u);

DAHL_WIDE __m512d dahl_wide_all(double x)
{
    return _mm512_set1_pd(x);
}

/** |x| with the signs of `sign`. */
DAHL_WIDE __m512d dahl_wide_with_sign(__m512d x, __m512i sign)
{
    enum { SECOND_IF_THIRD_ELSE_FIRST = 0xd8 };
    const __m512i place = _mm512_set1_epi64(INT64_MIN);
    __m512i bits = _mm512_castpd_si512(x);
    return _mm512_castsi512_pd(_mm512_ternarylogic_epi64(bits, sign, place, SECOND_IF_THIRD_ELSE_FIRST));
}

/** Replace NaN, detected by its class, by no travel. */
DAHL_WIDE __m512d dahl_wide_number(__m512d x)
{
    return _mm512_mask_mov_pd(x, _mm512_fpclass_pd_mask(x, DAHL_NAN_CLASS), _mm512_setzero_pd());
}

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
    __m512d most = _mm512_min_pd(u, dahl_wide_all(DAHL_ALL));
    __m512i k = _mm512_cvttpd_epi64(most * DAHL_LOG2E);
    __m512d r = most - _mm512_cvtepi64_pd(k) * DAHL_LN2, g = r * DAHL_SLOPE(r);
    __m512i left = _mm512_sub_epi64(_mm512_castpd_si512(1.0 - g), _mm512_slli_epi64(k, 52));
    return _mm512_mask_mov_pd(1.0 - _mm512_castsi512_pd(left), _mm512_testn_epi64_mask(k, k), g);
}

/** 2^-(j/16) for the eight j from `from` on, as bits plus j 2^48: see dahl_wide_e(). */
DAHL_WIDE __m512i dahl_wide_roots(int from)
{
    static const double roots[16] = {DAHL_ROOTS};
    __m512i j = _mm512_add_epi64(_mm512_setr_epi64(0, 1, 2, 3, 4, 5, 6, 7), _mm512_set1_epi64(from));
    return _mm512_add_epi64(_mm512_loadu_si512(roots + from), _mm512_slli_epi64(j, 48));
}

/**
 * e = 2^-(k + j/16 + f/16) of travels u >= 0 in units of ln 2/16, with whole k and j < 16 and f < 1. A sum with 2^52 has
 * 16 k + j as its last bits. Subtracting them from the bits of 2^-(j/16), 48 places up, divides by 2^k, since j is
 * cancelled. 1 - e errs by 2^-53, which is not small against a short travel: callers say why this does not sum up.
 */
DAHL_WIDE __m512d dahl_wide_e(__m512d u)
{
    __m512d most = _mm512_min_pd(u, dahl_wide_all(DAHL_ALL * DAHL_ROOTS_OF_E));
    __m512d floor = _mm512_floor_pd(most), f = most - floor;
    __m512i whole = _mm512_castpd_si512(floor + 0x1p52);
    __m512i root = _mm512_permutex2var_epi64(dahl_wide_roots(0), whole, dahl_wide_roots(8));
    return _mm512_castsi512_pd(_mm512_sub_epi64(root, _mm512_slli_epi64(whole, 48))) * DAHL_ROOT_POWER(f);
}

/** Maps of up to 15 counts, and of -8 to 7 counts: permutations that read the lowest four bits of words. */
typedef struct {
    dahl_eight_maps_t sizes[2], counts[2];
} dahl_wide_table_t;

#define DAHL_SIZES_MOST 15u
#define DAHL_COUNTS_MOST 7u

DAHL_WIDE dahl_eight_maps_t dahl_wide_look_up(const dahl_eight_maps_t table[2], __m512i places)
{
    dahl_eight_maps_t map = {_mm512_permutex2var_pd(table[0].e, places, table[1].e),
                             _mm512_permutex2var_pd(table[0].c, places, table[1].c)};
    return map;
}

/** Maps of W for x counts of any number, with travels of `roots` per count in units of ln 2/16. */
DAHL_WIDE dahl_eight_maps_t dahl_wide_map_of_any(__m512d x, __m512d roots, __m512d Fc)
{
    __m512d e = dahl_wide_e(_mm512_abs_pd(x) * roots), c = dahl_wide_with_sign(Fc, _mm512_castpd_si512(x));
    dahl_eight_maps_t map = {e, c - c * e};
    return map;
}

DAHL_WIDE dahl_wide_table_t dahl_wide_table(double a, double Fc)
{
    const __m512d eight = _mm512_setr_pd(0, 1, 2, 3, 4, 5, 6, 7);
    const __m512i from_minus_8 = _mm512_setr_epi64(8, 7, 6, 5, 4, 3, 2, 1);
    dahl_wide_table_t table;
    for (int i = 0; i < 2; i++) {
        __m512d g = dahl_wide_any(a * (eight + 8.0 * i));
        table.sizes[i].e = 1.0 - g;
        table.sizes[i].c = Fc * g;
    }
    table.counts[0] = table.sizes[0];
    table.counts[1] = dahl_wide_look_up(table.sizes, from_minus_8);
    table.counts[1].c = -table.counts[1].c;
    return table;
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
    const int32_t *from = moves;
    const size_t pairs = n / 32;
    __m512i one = _mm512_setzero_si512(), other = one;
    DAHL_NO_UNROLL
    for (size_t i = 0; i < pairs; i++) {
        one = _mm512_max_epu32(one, measure(_mm512_loadu_si512(from + 32 * i)));
        other = _mm512_max_epu32(other, measure(_mm512_loadu_si512(from + 32 * i + 16)));
    }
    for (size_t i = 32 * pairs; i < n; i += 16) {
        uint32_t used = n - i < 16 ? (1u << (n - i)) - 1u : 0xffffu;
        one = _mm512_max_epu32(one, measure(_mm512_maskz_loadu_epi32((__mmask16)used, from + i)));
    }
    return _mm512_reduce_max_epu32(_mm512_max_epu32(one, other));
}

#endif
#endif

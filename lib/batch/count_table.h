/* SPDX-License-Identifier: MIT */
/**
 * g of few counts from a table in two AVX-512 registers.
 *
 * If all ticks have one travel per count, one permutation replaces a polynomial: for one trajectory (trajectory_tiles.h)
 * and for uniform channels (channels.c).
 */
#ifndef DAHL_BATCH_COUNT_TABLE_H
#define DAHL_BATCH_COUNT_TABLE_H

#include "throughput.h"

#define DAHL_TABLE_MOST 15u /* counts */
#define DAHL_TABLE_ENTRIES (DAHL_TABLE_MOST + 1u)

#ifdef DAHL_AVX512

#include <immintrin.h>

#define DAHL_WIDE DAHL_AVX512 DAHL_INLINE /* a function that uses 512-bit registers */

DAHL_WIDE __m512d dahl_with_sign_of(__m512i number, __m512d size)
{
    const __m512i sign = _mm512_set1_epi64(INT64_MIN);
    return _mm512_or_pd(size, _mm512_castsi512_pd(_mm512_and_si512(number, sign)));
}

/** Return g of eight moves by their counts. The permutation reads the lowest four bits of each 64-bit word. */
DAHL_WIDE __m512d dahl_table_look_up(const __m512d table[2], __m512i counts)
{
    return _mm512_permutex2var_pd(table[0], counts, table[1]);
}

#endif
#endif

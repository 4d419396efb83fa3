/* SPDX-License-Identifier: MIT */
/*
 * g of few counts from a table in two registers of AVX-512, private: where all ticks have one travel a count, one permutation
 * stands for a polynomial. For one trajectory (fast_tiles.h) and for channels that are alike (fast_channels.c).
 */
#ifndef DAHL_BATCH_FAST_TABLE_H
#define DAHL_BATCH_FAST_TABLE_H

#include "fast.h"

#define DAHL_TABLE_MOST 15u /* counts */
#define DAHL_TABLE_ENTRIES (DAHL_TABLE_MOST + 1u)

#ifdef DAHL_AVX512

#include <immintrin.h>

#define DAHL_WIDE DAHL_AVX512 DAHL_INLINE /* a function in registers of 512 bits */

DAHL_WIDE __m512d dahl_with_sign_of(__m512i number, __m512d size)
{
    const __m512i sign = _mm512_set1_epi64(INT64_MIN);
    return _mm512_or_pd(size, _mm512_castsi512_pd(_mm512_and_si512(number, sign)));
}

/* g of eight moves by their counts: a permutation looks at the lowest four bits of each word of 64. */
DAHL_WIDE __m512d dahl_table_look_up(const __m512d table[2], __m512i counts)
{
    return _mm512_permutex2var_pd(table[0], counts, table[1]);
}

#endif
#endif

/* SPDX-License-Identifier: MIT */
/**
 * The maps W -> e W + c of ticks (throughput.h) from a table in memory, for AVX2. An entry has the map of a number of
 * counts. To load its 16 bytes costs less than a polynomial, or than permutations of registers.
 * - Range: a travel of DAHL_MAP_ALL closes the gap within the error of g. If the table reaches it, larger moves are
 *   clamped to it, so such a table serves any move.
 * - Growth: a block with larger moves extends the table. An entry costs as much as some ticks, so the table of a call of n
 *   ticks covers at most n/DAHL_MAP_PAYS counts.
 */
#ifndef DAHL_BATCH_MAP_TABLE_H
#define DAHL_BATCH_MAP_TABLE_H

#include <string.h>

#include "throughput.h"

#ifdef DAHL_AVX2

#include <immintrin.h>

#define DAHL_FOUR DAHL_AVX2 DAHL_INLINE /* a function that uses 256-bit registers */
#define DAHL_MAP_MOST 511               /* counts; 16 KiB */
#define DAHL_MAP_PAYS 4                 /* ticks of a call for each count in the table, or pair */
#define DAHL_MAP_ALL 24.0               /* travel: exp(-24) < 2^-34 */

/** The map x -> e x + c of a tick, or of several in a row. */
typedef struct {
    double e, c;
} dahl_map_t;

typedef struct {
    double a, Fc;
    int32_t most, limit; /* counts that the table covers, and may cover */
    bool closes;         /* the limit closes the gap, so larger moves may be clamped to it */
    size_t pays;         /* counts or pairs that the ticks of this call pay for */
    dahl_map_t entries[2 * DAHL_MAP_MOST + 1] __attribute__((aligned(64)));
} dahl_map_table_t;

/** Four maps. */
typedef struct {
    __m256d e, c;
} dahl_four_maps_t;

/** The maps `first`, then the maps `then`. */
DAHL_FOUR dahl_four_maps_t dahl_four_join(dahl_four_maps_t first, dahl_four_maps_t then)
{
    dahl_four_maps_t both = {then.e * first.e, then.e * first.c + then.c};
    return both;
}

/** Distance of an entry from the center of the table, in doubles: 2 n, or saturated. */
typedef int16_t dahl_place_t;

/** Pack 16 moves to places, and keep the largest |n| of each lane. Return the moves, saturated. */
DAHL_FOUR __m256i dahl_map_pack(dahl_place_t places[16], const int32_t moves[16], __m256i *most)
{
    __m256i first = _mm256_loadu_si256((const void *)moves), last = _mm256_loadu_si256((const void *)(moves + 8));
    __m256i all = _mm256_permute4x64_epi64(_mm256_packs_epi32(first, last), 0xd8);
    *most = _mm256_max_epu16(*most, _mm256_abs_epi16(all));
    _mm256_storeu_si256((void *)places, _mm256_adds_epi16(all, all));
    return all;
}

/** Return the largest lane: of saturated moves at least INT16_MAX. */
DAHL_FOUR int32_t dahl_map_largest(__m256i most)
{
    __m128i eight = _mm_max_epu16(_mm256_castsi256_si128(most), _mm256_extracti128_si256(most, 1));
    return 0xffff - _mm_extract_epi16(_mm_minpos_epu16(_mm_xor_si128(eight, _mm_set1_epi16(-1))), 0);
}

/** Clamp places to +-limit. n is a multiple of 16. */
DAHL_FOUR void dahl_map_clamp(dahl_place_t *places, size_t n, int32_t limit)
{
    const __m256i high = _mm256_set1_epi16((int16_t)(2 * limit)), low = _mm256_set1_epi16((int16_t)(-2 * limit));
    for (size_t i = 0; i < n; i += 16) {
        __m256i all = _mm256_loadu_si256((const void *)(places + i));
        _mm256_storeu_si256((void *)(places + i), _mm256_max_epi16(_mm256_min_epi16(all, high), low));
    }
}

/** Start an empty table for n ticks. */
DAHL_FOUR void dahl_map_start(dahl_map_table_t *table, double a, double Fc, size_t n)
{
    size_t pays = n / DAHL_MAP_PAYS;
    int32_t limit = a < DAHL_ABSOLUTE_LEAST ? -1 : pays < DAHL_MAP_MOST ? (int32_t)pays : DAHL_MAP_MOST;
    table->a = a;
    table->Fc = Fc;
    table->most = -1;
    table->pays = pays;
    table->closes = a * limit > DAHL_MAP_ALL;
    table->limit = table->closes ? (int32_t)(DAHL_MAP_ALL / a) + 1 : limit;
}

/** Extend the table to n moves of up to `most` counts. Return false if it cannot, or if this does not pay. */
DAHL_FOUR bool dahl_map_cover(dahl_map_table_t *table, dahl_place_t *places, size_t n, int32_t most)
{
    if (most > table->limit) {
        if (!table->closes) {
            return false;
        }
        most = table->limit;
        dahl_map_clamp(places, n, most);
    }
    dahl_map_t *center = table->entries + DAHL_MAP_MOST;
    while (table->most < most) {
        double g = dahl_g_any(table->a * ++table->most);
        dahl_map_t forth = {1.0 - g, table->Fc * g}, back = {1.0 - g, table->Fc * -g};
        center[table->most] = forth;
        center[-table->most] = back;
    }
    return true;
}

DAHL_FOUR const double *dahl_map_center(const dahl_map_table_t *table)
{
    return &table->entries[DAHL_MAP_MOST].e;
}

/** Read four places at once, since loads limit the speed. */
DAHL_FOUR uint64_t dahl_map_load(const dahl_place_t *places)
{
    uint64_t four;
    (void)memcpy(&four, places, sizeof four);
    return four;
}

/** Read the entry at place number i of the four: its e and c. */
DAHL_FOUR __m128d dahl_map_entry(const double *center, uint64_t four, int i)
{
    return _mm_load_pd(center + (dahl_place_t)(four >> 16 * i));
}

/** Transpose the entries of four ticks to maps. */
DAHL_FOUR dahl_four_maps_t dahl_map_four(__m128d tick0, __m128d tick1, __m128d tick2, __m128d tick3)
{
    __m256d even = _mm256_insertf128_pd(_mm256_castpd128_pd256(tick0), tick2, 1);
    __m256d odd = _mm256_insertf128_pd(_mm256_castpd128_pd256(tick1), tick3, 1);
    dahl_four_maps_t maps = {_mm256_unpacklo_pd(even, odd), _mm256_unpackhi_pd(even, odd)};
    return maps;
}

#endif
#endif

/* SPDX-License-Identifier: MIT */
/**
 * The scan of trajectory.c with AVX2 and maps from a table (map_table.h).
 * - segments: a block is 8 segments of 64 ticks. Lane i of register v runs through segment 2 i + v.
 * - first pass: of two ticks in a row, the map of the first, and the map from the start of the segment to the second.
 * - start: W at the start of each segment, from the maps of whole segments.
 * - second pass: one product for each tick, then 4 ticks of 4 segments are transposed and stored.
 * Two registers are independent chains, which hide the latency of a product. More of them would not fit in 16 registers.
 */
#ifndef DAHL_BATCH_TRAJECTORY_SEGMENTS_H
#define DAHL_BATCH_TRAJECTORY_SEGMENTS_H

#include "map_table.h"

#ifdef DAHL_FOUR

#define DAHL_SEGMENT 64                                        /* ticks */
#define DAHL_SEGMENT_SETS 2                                    /* registers of four segments */
#define DAHL_SEGMENT_STRIDE (DAHL_SEGMENT * DAHL_SEGMENT_SETS) /* ticks between the lanes of a register */
#define DAHL_SEGMENTS_TICKS (4 * DAHL_SEGMENT_STRIDE)
#define DAHL_SEGMENT_LEAST_E 0x1p-200 /* floor at every fourth tick: products of e are no subnormal numbers */

/** Of two ticks in a row: e and c of the first, then e and c from the start of the segment to the second. Not a structure,
 * which GCC 12 would copy through integer registers. */
typedef struct {
    __m256d maps[DAHL_SEGMENT / 2][DAHL_SEGMENT_SETS][4];
} dahl_segments_t;

#define DAHL_PAIR_MOST 15 /* counts */
#define DAHL_PAIR_SIDE 32 /* pairs with the same first move */

/** Distance of a pair of moves from the center of the table of pairs, in doubles. */
typedef int32_t dahl_pair_place_t;

/** Of two moves: the map of the first, and of both. */
typedef struct {
    dahl_map_t first, both;
} dahl_pair_t;

/** A table of single moves, and one of pairs of few counts. It halves the loads. */
typedef struct {
    dahl_map_table_t single;
    int32_t most; /* counts that the pairs cover */
    dahl_pair_t pairs[DAHL_PAIR_SIDE * DAHL_PAIR_SIDE] __attribute__((aligned(64)));
} dahl_pair_table_t;

DAHL_FOUR dahl_pair_t *dahl_pair_center(dahl_pair_table_t *table)
{
    return table->pairs + DAHL_PAIR_SIDE / 2 * (DAHL_PAIR_SIDE + 1);
}

/** Convert a block of moves to places, and to those of pairs. Return the largest |n|, or at least INT16_MAX. */
DAHL_FOUR int32_t dahl_pair_places(dahl_place_t *places, dahl_pair_place_t *pairs, const int32_t *moves)
{
    const __m256i weights = _mm256_set1_epi32(4 << 16 | 4 * DAHL_PAIR_SIDE);
    __m256i most = _mm256_setzero_si256();
    for (size_t t = 0; t < DAHL_SEGMENTS_TICKS; t += 16) {
        __m256i all = dahl_map_pack(places + t, moves + t, &most);
        _mm256_storeu_si256((void *)(pairs + t / 2), _mm256_madd_epi16(all, weights));
    }
    return dahl_map_largest(most);
}

/** Make the pairs of all moves up to `most`, if the table of single moves covers them. Return false if this does not pay. */
DAHL_FOUR bool dahl_pair_cover(dahl_pair_table_t *table, int32_t most)
{
    const dahl_map_t *center = table->single.entries + DAHL_MAP_MOST;
    dahl_pair_t *pairs = dahl_pair_center(table);
    if (most <= table->most) {
        return true;
    }
    const size_t side = 2 * (size_t)most + 1;
    if (most > DAHL_PAIR_MOST || most > table->single.most || side * side > table->single.pays) {
        return false;
    }
    for (int32_t i = -most; i <= most; i++) {
        for (int32_t k = -most; k <= most; k++) {
            dahl_map_t both = {center[k].e * center[i].e, center[k].e * center[i].c + center[k].c};
            pairs[DAHL_PAIR_SIDE * i + k].first = center[i];
            pairs[DAHL_PAIR_SIDE * i + k].both = both;
        }
    }
    table->most = most;
    return true;
}

/** Transpose four pairs to the maps of their first ticks and of both. */
DAHL_FOUR void dahl_pair_exchange(const __m256d pair[4], dahl_four_maps_t *first, dahl_four_maps_t *both)
{
    __m256d e01 = _mm256_unpacklo_pd(pair[0], pair[1]), e23 = _mm256_unpacklo_pd(pair[2], pair[3]);
    __m256d c01 = _mm256_unpackhi_pd(pair[0], pair[1]), c23 = _mm256_unpackhi_pd(pair[2], pair[3]);
    first->e = _mm256_permute2f128_pd(e01, e23, 0x20);
    first->c = _mm256_permute2f128_pd(c01, c23, 0x20);
    both->e = _mm256_permute2f128_pd(e01, e23, 0x31);
    both->c = _mm256_permute2f128_pd(c01, c23, 0x31);
}

/** Makes the maps of two ticks of each lane: of the first tick, and of both. Pair k of four ticks, with their places in a
 * table. */
typedef void (*dahl_pair_maps_t)(const double *center, const uint64_t places[4], int k, dahl_four_maps_t *first,
                                 dahl_four_maps_t *both);

DAHL_FOUR void dahl_segment_pair(const double *center, const uint64_t places[4], int k, dahl_four_maps_t *first,
                                 dahl_four_maps_t *both)
{
    *first = dahl_map_four(dahl_map_entry(center, places[0], 2 * k), dahl_map_entry(center, places[1], 2 * k),
                           dahl_map_entry(center, places[2], 2 * k), dahl_map_entry(center, places[3], 2 * k));
    *both = dahl_map_four(dahl_map_entry(center, places[0], 2 * k + 1), dahl_map_entry(center, places[1], 2 * k + 1),
                          dahl_map_entry(center, places[2], 2 * k + 1), dahl_map_entry(center, places[3], 2 * k + 1));
    *both = dahl_four_join(*first, *both);
}

DAHL_FOUR void dahl_segment_pair_by_table(const double *center, const uint64_t places[4], int k, dahl_four_maps_t *first,
                                          dahl_four_maps_t *both)
{
    __m256d pairs[4];
    for (int i = 0; i < 4; i++) {
        pairs[i] = _mm256_load_pd(center + (dahl_pair_place_t)(places[i] >> 32 * k));
    }
    dahl_pair_exchange(pairs, first, both);
}

/** First pass, four ticks of the lanes of register v, from pair t on. `maps` are those from the start of the segments. */
DAHL_FOUR void dahl_segments_read_four(dahl_segments_t *segments, const double *center, const dahl_place_t *from,
                                       dahl_pair_maps_t maps_of, size_t t, int v, dahl_four_maps_t *maps)
{
    uint64_t places[4]; /* of each lane */
    for (int i = 0; i < 4; i++) {
        places[i] = dahl_map_load(from + (DAHL_SEGMENT_STRIDE * i + DAHL_SEGMENT * v));
    }
    DAHL_UNROLL_8
    for (int k = 0; k < 2; k++) {
        dahl_four_maps_t first, both;
        __m256d *to = segments->maps[t + (size_t)k][v];
        maps_of(center, places, k, &first, &both);
        *maps = dahl_four_join(*maps, both);
        to[0] = first.e;
        to[1] = first.c;
        to[2] = maps->e;
        to[3] = maps->c;
    }
    maps->e = _mm256_max_pd(maps->e, _mm256_set1_pd(DAHL_SEGMENT_LEAST_E));
}

/** First pass. from_start gets the maps of whole segments. */
DAHL_FOUR void dahl_segments_read(dahl_segments_t *segments, const double *center, const void *places,
                                  dahl_pair_maps_t maps_of, dahl_four_maps_t from_start[DAHL_SEGMENT_SETS])
{
    dahl_four_maps_t maps[DAHL_SEGMENT_SETS]; /* GCC 12 keeps them in registers, but not from_start */
    const dahl_place_t *from = places;
    for (int v = 0; v < DAHL_SEGMENT_SETS; v++) {
        maps[v].e = _mm256_set1_pd(1.0);
        maps[v].c = _mm256_setzero_pd();
    }
    for (size_t t = 0; t < DAHL_SEGMENT / 2; t += 2, from += 4) {
        DAHL_UNROLL_8
        for (int v = 0; v < DAHL_SEGMENT_SETS; v++) {
            dahl_segments_read_four(segments, center, from, maps_of, t, v, &maps[v]);
        }
    }
    for (int v = 0; v < DAHL_SEGMENT_SETS; v++) {
        from_start[v].e = maps[v].e;
        from_start[v].c = maps[v].c;
    }
}

/** Compute W at the start of each segment. Return W at the end. */
DAHL_FOUR double dahl_segments_start(const dahl_four_maps_t maps[DAHL_SEGMENT_SETS], double W, __m256d start[DAHL_SEGMENT_SETS])
{
    dahl_four_maps_t lane = dahl_four_join(maps[0], maps[1]);
    double from[4];
    for (int i = 0; i < 4; i++) {
        from[i] = W;
        W = lane.e[i] * W + lane.c[i];
    }
    start[0] = _mm256_setr_pd(from[0], from[1], from[2], from[3]);
    for (int v = 1; v < DAHL_SEGMENT_SETS; v++) {
        start[v] = maps[v - 1].e * start[v - 1] + maps[v - 1].c;
    }
    return W;
}

/** Store row k of four lanes as tick k of each lane. */
DAHL_FOUR void dahl_segment_store(__m128 rows[4], float *F)
{
    _MM_TRANSPOSE4_PS(rows[0], rows[1], rows[2], rows[3]);
    for (int i = 0; i < 4; i++) {
        _mm_storeu_ps(F + DAHL_SEGMENT_STRIDE * i, rows[i]);
    }
}

/** Second pass. */
DAHL_FOUR void dahl_segments_write(const dahl_segments_t *segments, const __m256d start[DAHL_SEGMENT_SETS], float *F)
{
    __m256d W[DAHL_SEGMENT_SETS];
    for (int v = 0; v < DAHL_SEGMENT_SETS; v++) {
        W[v] = start[v];
    }
    for (size_t t = 0; t < DAHL_SEGMENT / 2; t += 2, F += 4) {
        DAHL_UNROLL_8
        for (int v = 0; v < DAHL_SEGMENT_SETS; v++) {
            __m128 rows[4];
            DAHL_UNROLL_8
            for (int k = 0; k < 2; k++) {
                const __m256d *from = segments->maps[t + (size_t)k][v];
                rows[2 * k] = _mm256_cvtpd_ps(from[0] * W[v] + from[1]);
                W[v] = from[2] * start[v] + from[3];
                rows[2 * k + 1] = _mm256_cvtpd_ps(W[v]);
            }
            dahl_segment_store(rows, F + (DAHL_SEGMENT * v));
        }
    }
}

/** Process a block from W, with a table by its center. Return W at its end. */
DAHL_FOUR double dahl_segments_run(const double *center, const void *places, dahl_pair_maps_t maps_of, double W, float *F)
{
    dahl_segments_t segments;
    dahl_four_maps_t from_start[DAHL_SEGMENT_SETS];
    __m256d start[DAHL_SEGMENT_SETS];
    dahl_segments_read(&segments, center, places, maps_of, from_start);
    W = dahl_segments_start(from_start, W, start);
    dahl_segments_write(&segments, start, F);
    return W;
}

#endif
#endif

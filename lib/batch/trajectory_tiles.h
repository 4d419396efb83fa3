/* SPDX-License-Identifier: MIT */
/**
 * The scan of trajectory.c in AVX-512 registers. A compiler uses more shuffles and no tables in registers. This form
 * needs half of its time for moves of few counts, and two thirds otherwise (docs/decisions/04).
 * - lanes: a tile is 64 ticks. Lane i of vector k is tick 8 i + k, so each lane runs through 8 ticks in a row.
 * - pairs: ticks 2 m and 2 m + 1 of a lane share one 64-bit word until they become doubles, which halves the
 *   shuffles.
 * - tables: maps of up to 7 counts, and g of up to 15 counts (wide.h).
 * - two passes over a block, with the maps in memory: from moves to maps, then from maps to torques.
 * - turns: two tiles take turns in each pass. The latency of one exceeds the look-ahead of a processor.
 */
#ifndef DAHL_BATCH_TRAJECTORY_TILES_H
#define DAHL_BATCH_TRAJECTORY_TILES_H

#include "wide.h"

#ifdef DAHL_AVX512

#define DAHL_NIBBLE_MOST 7u /* counts */
#define DAHL_LANES 8        /* doubles in a register, ticks in a lane */
#define DAHL_TILES 8        /* tiles in a block */
#define DAHL_TURNS 2        /* tiles that take turns */
#define DAHL_TILE_TICKS (DAHL_LANES * DAHL_LANES)
#define DAHL_TILES_TICKS (DAHL_TILES * DAHL_TILE_TICKS)
#define DAHL_LEAST_E 0x1p-110 /* of a lane: its 8th power times d is no subnormal number (see dahl_w_of) */

/** The map d -> e d + c of a tick, or of several in a row. */
typedef struct {
    __m512d e, c;
} dahl_map_t;

typedef struct {
    __m512d table[2];   /* g of 0 .. 15 counts */
    __m512d e[2], c[2]; /* maps of 0 .. 7, -8 .. -1 counts */
    __m512d a, w0, Fc, F0;
} dahl_tile_element_t;

/** The maps of the ticks of a block, and d at the start of each lane. */
typedef struct {
    dahl_map_t maps[DAHL_TILES][DAHL_LANES];
    __m512d start[DAHL_TILES];
} dahl_tiles_t;

/** Computes the maps of two ticks of each lane. */
typedef void (*dahl_tile_maps_t)(const dahl_tile_element_t *element, __m512i pair, dahl_map_t maps[2]);

DAHL_WIDE __m512d dahl_tile_all(double x)
{
    return _mm512_set1_pd(x);
}

/** Load a tile. lanes[m] gets ticks 2 m and 2 m + 1 of each lane; in memory this is pair 4 i + m for lane i. */
DAHL_WIDE void dahl_tile_load(const void *moves, __m512i lanes[4])
{
    const __m512i first = _mm512_setr_epi64(0, 4, 8, 12, 1, 5, 9, 13), last = _mm512_setr_epi64(2, 6, 10, 14, 3, 7, 11, 15);
    const unsigned char *from = moves;
    __m512i a = _mm512_loadu_si512(from), b = _mm512_loadu_si512(from + 64);
    __m512i c = _mm512_loadu_si512(from + 128), d = _mm512_loadu_si512(from + 192);
    __m512i ab01 = _mm512_permutex2var_epi64(a, first, b), cd01 = _mm512_permutex2var_epi64(c, first, d);
    __m512i ab23 = _mm512_permutex2var_epi64(a, last, b), cd23 = _mm512_permutex2var_epi64(c, last, d);
    lanes[0] = _mm512_shuffle_i64x2(ab01, cd01, 0x44);
    lanes[1] = _mm512_shuffle_i64x2(ab01, cd01, 0xee);
    lanes[2] = _mm512_shuffle_i64x2(ab23, cd23, 0x44);
    lanes[3] = _mm512_shuffle_i64x2(ab23, cd23, 0xee);
}

/** Store a tile, from F[k] with tick k of each lane. */
DAHL_WIDE void dahl_tile_store(const __m256 F[8], float *to)
{
    const __m512i mixed = _mm512_setr_epi32(0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
    __m512i pair[4], even[2], odd[2]; /* even and odd lanes; ticks 0 to 3 and 4 to 7 */
    DAHL_UNROLL_8
    for (int m = 0; m < 4; m++) {
        __m512 one = _mm512_castps256_ps512(F[2 * m]), other = _mm512_castps256_ps512(F[2 * m + 1]);
        pair[m] = _mm512_castps_si512(_mm512_permutex2var_ps(one, mixed, other));
    }
    DAHL_UNROLL_8
    for (int half = 0; half < 2; half++) {
        even[half] = _mm512_unpacklo_epi64(pair[2 * half], pair[2 * half + 1]);
        odd[half] = _mm512_unpackhi_epi64(pair[2 * half], pair[2 * half + 1]);
    }
    __m512i lanes02 = _mm512_shuffle_i64x2(even[0], even[1], 0x44), lanes13 = _mm512_shuffle_i64x2(odd[0], odd[1], 0x44);
    __m512i lanes46 = _mm512_shuffle_i64x2(even[0], even[1], 0xee), lanes57 = _mm512_shuffle_i64x2(odd[0], odd[1], 0xee);
    _mm512_storeu_si512(to, _mm512_shuffle_i64x2(lanes02, lanes13, 0x88));
    _mm512_storeu_si512(to + 16, _mm512_shuffle_i64x2(lanes02, lanes13, 0xdd));
    _mm512_storeu_si512(to + 32, _mm512_shuffle_i64x2(lanes46, lanes57, 0x88));
    _mm512_storeu_si512(to + 48, _mm512_shuffle_i64x2(lanes46, lanes57, 0xdd));
}

DAHL_WIDE dahl_map_t dahl_tile_map(const dahl_tile_element_t *element, dahl_wide_g_t g)
{
    dahl_map_t map = {1.0 - g.size, dahl_wide_with_sign(g) - element->w0 * g.size};
    return map;
}

/** Moves of -8 .. 7 counts: the last four bits of a move are its place in the tables. */
DAHL_WIDE void dahl_tile_maps_few(const dahl_tile_element_t *element, __m512i pair, dahl_map_t maps[2])
{
    __m512i second = _mm512_srli_epi64(pair, 32);
    maps[0].e = dahl_wide_look_up(element->e, pair);
    maps[0].c = dahl_wide_look_up(element->c, pair);
    maps[1].e = dahl_wide_look_up(element->e, second);
    maps[1].c = dahl_wide_look_up(element->c, second);
}

DAHL_WIDE void dahl_tile_maps_table(const dahl_tile_element_t *element, __m512i pair, dahl_map_t maps[2])
{
    __m512i counts = _mm512_abs_epi32(pair);
    dahl_wide_g_t first = {dahl_wide_look_up(element->table, counts), _mm512_slli_epi64(pair, 32)};
    dahl_wide_g_t second = {dahl_wide_look_up(element->table, _mm512_srli_epi64(counts, 32)), pair};
    maps[0] = dahl_tile_map(element, first);
    maps[1] = dahl_tile_map(element, second);
}

DAHL_WIDE void dahl_tile_counts(__m512i pair, __m512d x[2])
{
    x[0] = _mm512_cvtepi64_pd(_mm512_srai_epi64(_mm512_slli_epi64(pair, 32), 32));
    x[1] = _mm512_cvtepi64_pd(_mm512_srai_epi64(pair, 32));
}

DAHL_WIDE void dahl_tile_angles(__m512i pair, __m512d x[2])
{
    x[0] = _mm512_cvtps_pd(_mm256_castsi256_ps(_mm512_cvtepi64_epi32(pair)));
    x[1] = _mm512_cvtps_pd(_mm256_castsi256_ps(_mm512_cvtepi64_epi32(_mm512_srli_epi64(pair, 32))));
}

DAHL_WIDE void dahl_tile_angles_or_nan(__m512i pair, __m512d x[2])
{
    dahl_tile_angles(pair, x);
    x[0] = dahl_wide_number(x[0]);
    x[1] = dahl_wide_number(x[1]);
}

#define DAHL_TILE_MAPS(moves, kernel)                                                                                          \
    DAHL_WIDE void dahl_tile_maps_##kernel##_##moves(const dahl_tile_element_t *element, __m512i pair, dahl_map_t maps[2])     \
    {                                                                                                                          \
        __m512d x[2];                                                                                                          \
        dahl_tile_##moves(pair, x);                                                                                            \
        maps[0] = dahl_tile_map(element, dahl_wide_g(element->a * x[0], dahl_wide_##kernel));                                  \
        maps[1] = dahl_tile_map(element, dahl_wide_g(element->a * x[1], dahl_wide_##kernel));                                  \
    }
DAHL_TILE_MAPS(counts, tiny)
DAHL_TILE_MAPS(counts, small)
DAHL_TILE_MAPS(counts, any)
DAHL_TILE_MAPS(angles, tiny)
DAHL_TILE_MAPS(angles, small)
DAHL_TILE_MAPS(angles_or_nan, any)

/** The map `first`, then the map `then`. */
DAHL_WIDE dahl_map_t dahl_tile_join(dahl_map_t first, dahl_map_t then)
{
    dahl_map_t both = {then.e * first.e, then.e * first.c + then.c};
    return both;
}

/** Shift the lanes up by 1, 2 or 4, and fill with those of `first`. */
DAHL_WIDE __m512d dahl_tile_up(__m512d x, __m512d first, int lanes)
{
    __m512i high = _mm512_castpd_si512(x), low = _mm512_castpd_si512(first);
    return _mm512_castsi512_pd(lanes == 1   ? _mm512_alignr_epi64(high, low, 7)
                               : lanes == 2 ? _mm512_alignr_epi64(high, low, 6)
                                            : _mm512_alignr_epi64(high, low, 4));
}

/** Join the map of each lane to that of the lane 1, 2 or 4 below it, if there is one. */
DAHL_WIDE dahl_map_t dahl_tile_join_lanes(dahl_map_t map, int lanes)
{
    dahl_map_t below = {dahl_tile_up(map.e, dahl_tile_all(1.0), lanes), dahl_tile_up(map.c, _mm512_setzero_pd(), lanes)};
    return dahl_tile_join(below, map);
}

/** Make the maps of tiles in turns. Return their joined pairs of ticks. */
DAHL_WIDE void dahl_tile_make_maps(dahl_map_t maps[][DAHL_LANES], const dahl_tile_element_t *element, const void *moves,
                                   dahl_tile_maps_t maps_of, dahl_map_t pairs[DAHL_TURNS][4])
{
    __m512i lanes[DAHL_TURNS][4];
    for (int i = 0; i < DAHL_TURNS; i++) {
        dahl_tile_load((const unsigned char *)moves + 4 * DAHL_TILE_TICKS * i, lanes[i]);
    }
    DAHL_UNROLL_8
    for (int m = 0; m < 4; m++) {
        DAHL_UNROLL_8
        for (int i = 0; i < DAHL_TURNS; i++) {
            dahl_map_t two[2];
            maps_of(element, lanes[i][m], two);
            maps[i][2 * m] = two[0];
            maps[i][2 * m + 1] = two[1];
            pairs[i][m] = dahl_tile_join(two[0], two[1]);
        }
    }
}

/** Join the pairs of ticks of each lane, then the lanes below each lane: the maps from the start of the tiles. */
DAHL_WIDE void dahl_tile_join_all(dahl_map_t pairs[DAHL_TURNS][4], dahl_map_t from_start[DAHL_TURNS])
{
    DAHL_UNROLL_8
    for (int i = 0; i < DAHL_TURNS; i++) {
        from_start[i] = dahl_tile_join(dahl_tile_join(pairs[i][0], pairs[i][1]), dahl_tile_join(pairs[i][2], pairs[i][3]));
        from_start[i].e = _mm512_max_pd(from_start[i].e, dahl_tile_all(DAHL_LEAST_E));
    }
    DAHL_UNROLL_8
    for (int lanes = 1; lanes < DAHL_LANES; lanes *= 2) {
        DAHL_UNROLL_8
        for (int i = 0; i < DAHL_TURNS; i++) {
            from_start[i] = dahl_tile_join_lanes(from_start[i], lanes);
        }
    }
}

/** First pass, from tile t on: maps and starts. Return d at the end, from d at the start, in all lanes. */
DAHL_WIDE __m512d dahl_tile_read(dahl_tiles_t *tiles, int t, const dahl_tile_element_t *element, const void *moves,
                                 dahl_tile_maps_t maps_of, __m512d d)
{
    dahl_map_t pairs[DAHL_TURNS][4], from_start[DAHL_TURNS];
    dahl_tile_make_maps(tiles->maps + t, element, moves, maps_of, pairs);
    dahl_tile_join_all(pairs, from_start);
    for (int i = 0; i < DAHL_TURNS; i++) {
        __m512d ends = from_start[i].e * d + from_start[i].c;
        tiles->start[t + i] = dahl_tile_up(ends, d, 1);
        d = _mm512_permutexvar_pd(_mm512_set1_epi64(DAHL_LANES - 1), ends);
    }
    return d;
}

/** Second pass, from tile t on: torques. */
DAHL_WIDE void dahl_tile_write(const dahl_tiles_t *tiles, int t, const dahl_tile_element_t *element, float *to)
{
    __m256 F[DAHL_TURNS][DAHL_LANES];
    __m512d d[DAHL_TURNS] = {tiles->start[t], tiles->start[t + 1]};
    DAHL_UNROLL_8
    for (int k = 0; k < DAHL_LANES; k++) {
        DAHL_UNROLL_8
        for (int i = 0; i < DAHL_TURNS; i++) {
            d[i] = tiles->maps[t + i][k].e * d[i] + tiles->maps[t + i][k].c;
            F[i][k] = _mm512_cvtpd_ps(element->Fc * d[i] + element->F0);
        }
    }
    for (int i = 0; i < DAHL_TURNS; i++) {
        dahl_tile_store(F[i], to + DAHL_TILE_TICKS * i);
    }
}

/** Input of a block: an element and its start. */
typedef struct {
    const dahl_throughput_scale_t *scale;
    const __m512d *table;
    double w0;
    const void *moves;
    float *F;
} dahl_tile_job_t;

DAHL_WIDE dahl_tile_element_t dahl_tile_element(const dahl_tile_job_t *job)
{
    const dahl_throughput_scale_t *scale = job->scale;
    const __m512d zero = _mm512_setzero_pd(), *table = job->table;
    dahl_tile_element_t element = {{table[0], table[1]},
                                   {zero, zero},
                                   {zero, zero},
                                   dahl_tile_all(scale->a),
                                   dahl_tile_all(job->w0),
                                   dahl_tile_all(scale->Fc),
                                   dahl_tile_all(scale->Fc * job->w0)};
    __m512d back = _mm512_permutex2var_pd(table[0], _mm512_setr_epi64(8, 7, 6, 5, 4, 3, 2, 1), table[1]);
    dahl_wide_g_t g[2] = {{table[0], _mm512_setzero_si512()}, {back, _mm512_set1_epi64(-1)}};
    for (int i = 0; i < 2; i++) {
        dahl_map_t map = dahl_tile_map(&element, g[i]);
        element.e[i] = map.e;
        element.c[i] = map.c;
    }
    return element;
}

DAHL_WIDE double dahl_tiles_run(const dahl_tile_job_t *job, dahl_tile_maps_t maps_of)
{
    const dahl_tile_element_t element = dahl_tile_element(job);
    __m512d d = _mm512_setzero_pd();
    dahl_tiles_t tiles;
    for (int t = 0; t < DAHL_TILES; t += DAHL_TURNS) {
        d = dahl_tile_read(&tiles, t, &element, (const unsigned char *)job->moves + 4 * DAHL_TILE_TICKS * t, maps_of, d);
    }
    for (int t = 0; t < DAHL_TILES; t += DAHL_TURNS) {
        dahl_tile_write(&tiles, t, &element, job->F + DAHL_TILE_TICKS * t);
    }
    return _mm512_cvtsd_f64(d);
}

DAHL_WIDE double dahl_tiles_by_counts(const dahl_tile_job_t *job, uint32_t most)
{
    if (most <= DAHL_TABLE_MOST) {
        return most <= DAHL_NIBBLE_MOST ? dahl_tiles_run(job, dahl_tile_maps_few) : dahl_tiles_run(job, dahl_tile_maps_table);
    }
    return most <= job->scale->tiny    ? dahl_tiles_run(job, dahl_tile_maps_tiny_counts)
           : most <= job->scale->small ? dahl_tiles_run(job, dahl_tile_maps_small_counts)
                                       : dahl_tiles_run(job, dahl_tile_maps_any_counts);
}

DAHL_WIDE double dahl_tiles_by_angle(const dahl_tile_job_t *job, uint32_t most)
{
    return most <= job->scale->tiny    ? dahl_tiles_run(job, dahl_tile_maps_tiny_angles)
           : most <= job->scale->small ? dahl_tiles_run(job, dahl_tile_maps_small_angles)
                                       : dahl_tiles_run(job, dahl_tile_maps_any_angles_or_nan);
}

#endif
#endif

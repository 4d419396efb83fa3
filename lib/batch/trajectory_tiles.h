/* SPDX-License-Identifier: MIT */
/**
 * The scan of trajectory.c in AVX-512 registers. A compiler uses more shuffles, and no tables in registers
 * (docs/decisions/04).
 *
 * A tile is 64 ticks: lane i has ticks 8 i to 8 i + 7, one in each of eight registers. Three passes over a block, since
 * the latency of all of them for one tile exceeds the look-ahead of a processor:
 * -# Join the maps of the ticks of each lane.
 * -# Join the lanes. This gives the state at the start of each lane.
 * -# Apply the maps of the ticks, and write the torques.
 *
 * The maps of short moves are looked up in a table, both in the first and the last pass: a look-up costs less than a store.
 * Moves packed to bytes are its places. The maps of other moves are made before the passes and stored.
 */
#ifndef DAHL_BATCH_TRAJECTORY_TILES_H
#define DAHL_BATCH_TRAJECTORY_TILES_H

#include "wide.h"

#ifdef DAHL_AVX512

#define DAHL_LANES 8 /* doubles in a register, ticks of a lane */
#define DAHL_TILES 8 /* of a block */
#define DAHL_TURNS 2 /* tiles of the last pass that take turns */
#define DAHL_TILE_TICKS (DAHL_LANES * DAHL_LANES)
#define DAHL_TILES_TICKS (DAHL_TILES * DAHL_TILE_TICKS)
#define DAHL_LEAST_E 0x1p-64 /* of a lane: no product of eight lanes, Fc and a state is a subnormal number (see dahl_w_of) */

/* Measure of an infinite angle. That of NaN is larger, and hides whether an angle is long. */
#define DAHL_INFINITE 0x7f800000u

/** A block of moves from w, and where its torques go. */
typedef struct {
    const dahl_throughput_scale_t *scale;
    double w;
    const int32_t *moves; /* or bits of angles */
    float *F;
} dahl_tiles_job_t;

/** Where the maps of a block come from. */
typedef struct {
    const dahl_wide_table_t *table;
    __m512i bytes[DAHL_TILES]; /* byte k of 64-bit word i: tick k of lane i */
    dahl_eight_maps_t maps[DAHL_TILES][DAHL_LANES];
} dahl_tiles_t;

/** Returns the maps of tick k of the lanes of a tile. */
typedef dahl_eight_maps_t (*dahl_tile_maps_t)(const dahl_tiles_t *tiles, int tile, unsigned k);

/** Returns the torques of states. */
typedef __m256 (*dahl_tile_torques_t)(const dahl_tiles_job_t *job, __m512d state);

/** Shift the lanes up by 1, 2 or 4, and fill with those of `first`. */
DAHL_WIDE __m512d dahl_tile_up(__m512d x, __m512d first, int lanes)
{
    __m512i high = _mm512_castpd_si512(x), low = _mm512_castpd_si512(first);
    return _mm512_castsi512_pd(lanes == 1   ? _mm512_alignr_epi64(high, low, 7)
                               : lanes == 2 ? _mm512_alignr_epi64(high, low, 6)
                                            : _mm512_alignr_epi64(high, low, 4));
}

/** Join the map of each lane to that of the lane 1, 2 or 4 below it, if there is one. */
DAHL_WIDE dahl_eight_maps_t dahl_tile_join_lanes(dahl_eight_maps_t map, int lanes)
{
    dahl_eight_maps_t below = {dahl_tile_up(map.e, dahl_wide_all(1.0), lanes), dahl_tile_up(map.c, _mm512_setzero_pd(), lanes)};
    return dahl_eight_join(below, map);
}

/** Store a tile, from F[k] with tick k of each lane. */
DAHL_WIDE void dahl_tile_store(const __m256 F[DAHL_LANES], float *to)
{
    const __m512i mixed = _mm512_setr_epi32(0, 16, 4, 20, 1, 17, 5, 21, 2, 18, 6, 22, 3, 19, 7, 23);
    const __m512i first = _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11), last = _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15);
    __m512i pair[4], low[2], high[2]; /* low and high lanes; ticks 0 to 3 and 4 to 7 */
    DAHL_UNROLL_8
    for (int m = 0; m < 4; m++) {
        __m512 one = _mm512_castps256_ps512(F[2 * m]), other = _mm512_castps256_ps512(F[2 * m + 1]);
        pair[m] = _mm512_castps_si512(_mm512_permutex2var_ps(one, mixed, other));
    }
    DAHL_UNROLL_8
    for (int half = 0; half < 2; half++) {
        low[half] = _mm512_unpacklo_epi64(pair[2 * half], pair[2 * half + 1]);
        high[half] = _mm512_unpackhi_epi64(pair[2 * half], pair[2 * half + 1]);
    }
    _mm512_storeu_si512(to, _mm512_permutex2var_epi64(low[0], first, low[1]));
    _mm512_storeu_si512(to + 16, _mm512_permutex2var_epi64(low[0], last, low[1]));
    _mm512_storeu_si512(to + 32, _mm512_permutex2var_epi64(high[0], first, high[1]));
    _mm512_storeu_si512(to + 48, _mm512_permutex2var_epi64(high[0], last, high[1]));
}

DAHL_WIDE void dahl_tiles_join(dahl_eight_maps_t lanes[DAHL_TILES], const dahl_tiles_t *tiles, dahl_tile_maps_t map_of)
{
    DAHL_NO_UNROLL
    for (int t = 0; t < DAHL_TILES; t++) {
        dahl_eight_maps_t pair[4];
        DAHL_UNROLL_8
        for (unsigned m = 0; m < 4; m++) {
            pair[m] = dahl_eight_join(map_of(tiles, t, 2 * m), map_of(tiles, t, 2 * m + 1));
        }
        lanes[t] = dahl_eight_join(dahl_eight_join(pair[0], pair[1]), dahl_eight_join(pair[2], pair[3]));
    }
}

/** Return the state at the end, from that at the start, in all lanes. */
DAHL_WIDE __m512d dahl_tiles_start(__m512d starts[DAHL_TILES], const dahl_eight_maps_t lanes[DAHL_TILES], __m512d state)
{
    DAHL_NO_UNROLL
    for (int t = 0; t < DAHL_TILES; t++) {
        dahl_eight_maps_t map = {_mm512_max_pd(lanes[t].e, dahl_wide_all(DAHL_LEAST_E)), lanes[t].c};
        map = dahl_tile_join_lanes(map, 1);
        map = dahl_tile_join_lanes(map, 2);
        map = dahl_tile_join_lanes(map, 4);
        __m512d ends = map.e * state + map.c;
        starts[t] = dahl_tile_up(ends, state, 1);
        state = _mm512_permutexvar_pd(_mm512_set1_epi64(DAHL_LANES - 1), ends);
    }
    return state;
}

DAHL_WIDE void dahl_tiles_write(const dahl_tiles_job_t *job, const __m512d starts[DAHL_TILES], const dahl_tiles_t *tiles,
                                dahl_tile_maps_t map_of, dahl_tile_torques_t torques_of)
{
    DAHL_NO_UNROLL
    for (int t = 0; t < DAHL_TILES; t += DAHL_TURNS) {
        __m256 F[DAHL_TURNS][DAHL_LANES];
        __m512d state[DAHL_TURNS] = {starts[t], starts[t + 1]};
        DAHL_UNROLL_8
        for (unsigned k = 0; k < DAHL_LANES; k++) {
            DAHL_UNROLL_8
            for (int i = 0; i < DAHL_TURNS; i++) {
                dahl_eight_maps_t map = map_of(tiles, t + i, k);
                state[i] = map.e * state[i] + map.c;
                F[i][k] = torques_of(job, state[i]);
            }
        }
        for (int i = 0; i < DAHL_TURNS; i++) {
            dahl_tile_store(F[i], job->F + DAHL_TILE_TICKS * (t + i));
        }
    }
}

/** Run all passes. Return the state at the end, from that at the start. */
DAHL_WIDE double dahl_tiles_run(const dahl_tiles_job_t *job, double state, const dahl_tiles_t *tiles, dahl_tile_maps_t map_of,
                                dahl_tile_torques_t torques_of)
{
    dahl_eight_maps_t lanes[DAHL_TILES];
    __m512d starts[DAHL_TILES];
    dahl_tiles_join(lanes, tiles, map_of);
    __m512d end = dahl_tiles_start(starts, lanes, dahl_wide_all(state));
    dahl_tiles_write(job, starts, tiles, map_of, torques_of);
    return _mm512_cvtsd_f64(end);
}

/** The state is d. */
DAHL_WIDE __m256 dahl_tile_torques_of_d(const dahl_tiles_job_t *job, __m512d d)
{
    return _mm512_cvtpd_ps(job->scale->Fc * d + dahl_wide_all(job->scale->Fc * job->w));
}

/** The state is W. */
DAHL_WIDE __m256 dahl_tile_torques_of_W(const dahl_tiles_job_t *job, __m512d W)
{
    (void)job;
    return _mm512_cvtpd_ps(W);
}

/** Run the absolute form, with maps of W. Return the motion of w. */
DAHL_WIDE double dahl_tiles_run_absolute(const dahl_tiles_job_t *job, const dahl_tiles_t *tiles, dahl_tile_maps_t map_of)
{
    const double Fc = job->scale->Fc, from = Fc * job->w;
    return (dahl_tiles_run(job, from, tiles, map_of, dahl_tile_torques_of_W) - from) / Fc;
}

DAHL_WIDE dahl_eight_maps_t dahl_tile_counts_map(const dahl_tiles_t *tiles, int t, unsigned k)
{
    return dahl_wide_look_up(tiles->table->counts, _mm512_srli_epi64(tiles->bytes[t], 8 * k));
}

DAHL_WIDE dahl_eight_maps_t dahl_tile_sizes_map(const dahl_tiles_t *tiles, int t, unsigned k)
{
    __m512i places = _mm512_srli_epi64(_mm512_abs_epi8(tiles->bytes[t]), 8 * k);
    dahl_eight_maps_t map = dahl_wide_look_up(tiles->table->sizes, places);
    map.c = dahl_wide_with_sign(map.c, _mm512_slli_epi64(tiles->bytes[t], 56 - 8 * k));
    return map;
}

DAHL_WIDE dahl_eight_maps_t dahl_tile_made_map(const dahl_tiles_t *tiles, int t, unsigned k)
{
    return tiles->maps[t][k];
}

/** Pack a tile to signed bytes, which saturate. */
DAHL_WIDE __m512i dahl_tile_pack(const int32_t *from)
{
    const __m512i order = _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
    __m512i first = _mm512_packs_epi32(_mm512_loadu_si512(from), _mm512_loadu_si512(from + 16));
    __m512i last = _mm512_packs_epi32(_mm512_loadu_si512(from + 32), _mm512_loadu_si512(from + 48));
    return _mm512_permutexvar_epi32(order, _mm512_packs_epi16(first, last));
}

/** Pack a block. Return the bits of all sizes: no move is longer. */
DAHL_WIDE uint32_t dahl_tiles_pack(dahl_tiles_t *tiles, const int32_t *moves)
{
    __m512i bits = _mm512_setzero_si512();
    DAHL_UNROLL_8
    for (int t = 0; t < DAHL_TILES; t++) {
        tiles->bytes[t] = dahl_tile_pack(moves + DAHL_TILE_TICKS * t);
        bits = _mm512_or_si512(bits, _mm512_abs_epi8(tiles->bytes[t]));
    }
    return _mm512_test_epi8_mask(bits, _mm512_set1_epi8(~(int)DAHL_COUNTS_MOST)) == 0  ? DAHL_COUNTS_MOST
           : _mm512_test_epi8_mask(bits, _mm512_set1_epi8(~(int)DAHL_SIZES_MOST)) == 0 ? DAHL_SIZES_MOST
                                                                                       : UINT32_MAX;
}

/** Reads ticks 2 m and 2 m + 1 of the lanes of a tile, which share 64-bit words, as two registers. */
typedef void (*dahl_tile_values_t)(__m512i pair, __m512d x[2]);

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

/** Load a tile. pairs[m] gets ticks 2 m and 2 m + 1 of each lane; in memory this is pair 4 i + m for lane i. */
DAHL_WIDE void dahl_tile_load(const int32_t *from, __m512i pairs[4])
{
    const __m512i first = _mm512_setr_epi64(0, 4, 8, 12, 1, 5, 9, 13), last = _mm512_setr_epi64(2, 6, 10, 14, 3, 7, 11, 15);
    __m512i a = _mm512_loadu_si512(from), b = _mm512_loadu_si512(from + 16);
    __m512i c = _mm512_loadu_si512(from + 32), d = _mm512_loadu_si512(from + 48);
    __m512i ab01 = _mm512_permutex2var_epi64(a, first, b), cd01 = _mm512_permutex2var_epi64(c, first, d);
    __m512i ab23 = _mm512_permutex2var_epi64(a, last, b), cd23 = _mm512_permutex2var_epi64(c, last, d);
    pairs[0] = _mm512_shuffle_i64x2(ab01, cd01, 0x44);
    pairs[1] = _mm512_shuffle_i64x2(ab01, cd01, 0xee);
    pairs[2] = _mm512_shuffle_i64x2(ab23, cd23, 0x44);
    pairs[3] = _mm512_shuffle_i64x2(ab23, cd23, 0xee);
}

/** Returns the maps of moves x: of d in a block that starts at w, or of W. */
typedef dahl_eight_maps_t (*dahl_tile_kernel_t)(const dahl_tiles_job_t *job, __m512d x);

#define DAHL_TILE_KERNEL(kernel)                                                                                               \
    DAHL_WIDE dahl_eight_maps_t dahl_tile_##kernel(const dahl_tiles_job_t *job, __m512d x)                                     \
    {                                                                                                                          \
        __m512d g = dahl_wide_##kernel(_mm512_abs_pd(x) * job->scale->a);                                                      \
        dahl_eight_maps_t map = {1.0 - g, dahl_wide_with_sign(g, _mm512_castpd_si512(x)) - job->w * g};                        \
        return map;                                                                                                            \
    }
DAHL_TILE_KERNEL(tiny)
DAHL_TILE_KERNEL(small)
DAHL_TILE_KERNEL(any)

/** Maps of d for moves of any length. The block must have one longer than ln 2, which halves the errors of all others. */
DAHL_WIDE dahl_eight_maps_t dahl_tile_halving(const dahl_tiles_job_t *job, __m512d x)
{
    __m512d e = dahl_wide_e(_mm512_abs_pd(x) * (job->scale->a * DAHL_ROOTS_OF_E)), g = 1.0 - e;
    dahl_eight_maps_t map = {e, dahl_wide_with_sign(g, _mm512_castpd_si512(x)) - job->w * g};
    return map;
}

/** The same for maps of W, which err by 2^-53 anyway. */
DAHL_WIDE dahl_eight_maps_t dahl_tile_any_absolute(const dahl_tiles_job_t *job, __m512d x)
{
    return dahl_wide_map_of_any(x, dahl_wide_all(job->scale->a * DAHL_ROOTS_OF_E), dahl_wide_all(job->scale->Fc));
}

/** Make the maps of a block and store them. */
DAHL_WIDE void dahl_tiles_make(dahl_tiles_t *tiles, const dahl_tiles_job_t *job, dahl_tile_values_t values,
                               dahl_tile_kernel_t kernel)
{
    DAHL_NO_UNROLL
    for (int t = 0; t < DAHL_TILES; t++) {
        __m512i pairs[4];
        __m512d x[DAHL_LANES];
        dahl_tile_load(job->moves + DAHL_TILE_TICKS * t, pairs);
        DAHL_UNROLL_8
        for (int m = 0; m < 4; m++) {
            values(pairs[m], x + 2 * m);
        }
        DAHL_UNROLL_8
        for (int k = 0; k < DAHL_LANES; k++) {
            tiles->maps[t][k] = kernel(job, x[k]);
        }
    }
}

/** Run the form of d. Return the motion of w. */
DAHL_WIDE double dahl_tiles_run_d(const dahl_tiles_job_t *job, dahl_tiles_t *tiles, dahl_tile_values_t values,
                                  dahl_tile_kernel_t kernel)
{
    dahl_tiles_make(tiles, job, values, kernel);
    return dahl_tiles_run(job, 0.0, tiles, dahl_tile_made_map, dahl_tile_torques_of_d);
}

/** Process a block of counts. Return the motion of w. */
DAHL_WIDE double dahl_tiles_by_counts(const dahl_tiles_job_t *job, const dahl_wide_table_t *table)
{
    const bool is_absolute = job->scale->a >= DAHL_ABSOLUTE_LEAST;
    dahl_tiles_t tiles;
    tiles.table = table;
    uint32_t most = is_absolute ? dahl_tiles_pack(&tiles, job->moves) : UINT32_MAX;
    if (most == DAHL_COUNTS_MOST) {
        return dahl_tiles_run_absolute(job, &tiles, dahl_tile_counts_map);
    }
    if (most == DAHL_SIZES_MOST) {
        return dahl_tiles_run_absolute(job, &tiles, dahl_tile_sizes_map);
    }
    most = dahl_wide_largest(job->moves, DAHL_TILES_TICKS, dahl_wide_counts);
    if (most <= job->scale->small) {
        return most <= job->scale->tiny ? dahl_tiles_run_d(job, &tiles, dahl_tile_counts, dahl_tile_tiny)
                                        : dahl_tiles_run_d(job, &tiles, dahl_tile_counts, dahl_tile_small);
    }
    if (is_absolute) {
        dahl_tiles_make(&tiles, job, dahl_tile_counts, dahl_tile_any_absolute);
        return dahl_tiles_run_absolute(job, &tiles, dahl_tile_made_map);
    }
    return dahl_tiles_run_d(job, &tiles, dahl_tile_counts, dahl_tile_halving);
}

/** Process a block of angles. Return the motion of w. */
DAHL_WIDE double dahl_tiles_by_angle(const dahl_tiles_job_t *job)
{
    dahl_tiles_t tiles;
    uint32_t most = dahl_wide_largest(job->moves, DAHL_TILES_TICKS, dahl_wide_angles);
    return most <= job->scale->tiny    ? dahl_tiles_run_d(job, &tiles, dahl_tile_angles, dahl_tile_tiny)
           : most <= job->scale->small ? dahl_tiles_run_d(job, &tiles, dahl_tile_angles, dahl_tile_small)
           : most <= DAHL_INFINITE     ? dahl_tiles_run_d(job, &tiles, dahl_tile_angles, dahl_tile_halving)
                                       : dahl_tiles_run_d(job, &tiles, dahl_tile_angles_or_nan, dahl_tile_any);
}

#endif
#endif

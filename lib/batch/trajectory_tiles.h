/* SPDX-License-Identifier: MIT */
/**
 * The scan of trajectory.c in AVX-512 registers. A compiler uses more shuffles and no tables in registers. This form
 * needs two thirds of the time for moves of few counts, and a tenth less otherwise (docs/decisions/04).
 * - lanes: a tile is 64 ticks. Lane i of vector k is tick 8 i + k, so each lane runs through 8 ticks in a row.
 * - pairs: ticks 2 m and 2 m + 1 of a lane share one 64-bit word until they become doubles, which halves the
 *   shuffles.
 * - table: g of up to 15 counts (count_table.h).
 * - three passes over a block, with their input in memory, since the latency of a tile exceeds the look-ahead of a
 *   processor.
 */
#ifndef DAHL_BATCH_TRAJECTORY_TILES_H
#define DAHL_BATCH_TRAJECTORY_TILES_H

#include "count_table.h"

#ifdef DAHL_AVX512

#define DAHL_LANES 8 /* doubles in a register, ticks in a lane */
#define DAHL_TILES 8 /* tiles in a block */
#define DAHL_TILE_TICKS (DAHL_LANES * DAHL_LANES)
#define DAHL_TILES_TICKS (DAHL_TILES * DAHL_TILE_TICKS)
#define DAHL_LEAST_E 0x1p-110 /* of a lane: its 8th power times d is no subnormal number (see dahl_w_of) */
#define DAHL_NAN_CLASS 0x81 /* quiet and signalling NaN for fpclass */

typedef struct {
    __m512d table[2]; /* g of 0 .. 15 counts */
    __m512d a, w0, Fc, F0;
} dahl_tile_element_t;

/** Map d -> e d + c of each tick. to_e and to_c: the map from the start of the tile to the end of each lane. */
typedef struct {
    __m512d e[DAHL_TILES][DAHL_LANES], c[DAHL_TILES][DAHL_LANES], to_e[DAHL_TILES], to_c[DAHL_TILES];
} dahl_tiles_t;

/** Computes g of two ticks per lane, with the sign of the move. */
typedef void (*dahl_tile_g_t)(const dahl_tile_element_t *element, __m512i pair, __m512d g[2]);
typedef __m512d (*dahl_tile_kernel_t)(__m512d x);

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

DAHL_WIDE __m512d dahl_tile_small(__m512d x)
{
    __m512d u = _mm512_abs_pd(x);
    return x * DAHL_SLOPE(u);
}

DAHL_WIDE __m512d dahl_tile_tiny(__m512d x)
{
    __m512d u = _mm512_abs_pd(x);
    return x * DAHL_TINY_SLOPE(u);
}

/** The same as dahl_g_any(). NaN, detected by its class, is no travel. */
DAHL_WIDE __m512d dahl_tile_any(__m512d x)
{
    __m512d number = _mm512_mask_mov_pd(x, _mm512_fpclass_pd_mask(x, DAHL_NAN_CLASS), _mm512_setzero_pd());
    __m512d u = _mm512_min_pd(_mm512_abs_pd(number), _mm512_set1_pd(DAHL_ALL));
    __m512d k = _mm512_cvtepi32_pd(_mm512_cvttpd_epi32(u * DAHL_LOG2E));
    __m512d r = u - k * DAHL_LN2, g = r * DAHL_SLOPE(r);
    __m512d far = 1.0 - _mm512_scalef_pd(1.0 - g, -k);
    __mmask8 near = _mm512_cmp_pd_mask(k, _mm512_setzero_pd(), _CMP_EQ_OQ);
    return dahl_with_sign_of(_mm512_castpd_si512(number), _mm512_mask_mov_pd(far, near, g));
}

DAHL_WIDE void dahl_tile_g_by_table(const dahl_tile_element_t *element, __m512i pair, __m512d g[2])
{
    __m512i counts = _mm512_abs_epi32(pair);
    g[0] = dahl_with_sign_of(_mm512_slli_epi64(pair, 32), dahl_table_look_up(element->table, counts));
    g[1] = dahl_with_sign_of(pair, dahl_table_look_up(element->table, _mm512_srli_epi64(counts, 32)));
}

DAHL_WIDE void dahl_tile_g_by_counts(const dahl_tile_element_t *element, __m512i pair, dahl_tile_kernel_t kernel, __m512d g[2])
{
    __m512i first = _mm512_srai_epi64(_mm512_slli_epi64(pair, 32), 32), second = _mm512_srai_epi64(pair, 32);
    g[0] = kernel(element->a * _mm512_cvtepi64_pd(first));
    g[1] = kernel(element->a * _mm512_cvtepi64_pd(second));
}

DAHL_WIDE void dahl_tile_g_by_angle(const dahl_tile_element_t *element, __m512i pair, dahl_tile_kernel_t kernel, __m512d g[2])
{
    __m256i first = _mm512_cvtepi64_epi32(pair), second = _mm512_cvtepi64_epi32(_mm512_srli_epi64(pair, 32));
    g[0] = kernel(element->a * _mm512_cvtps_pd(_mm256_castsi256_ps(first)));
    g[1] = kernel(element->a * _mm512_cvtps_pd(_mm256_castsi256_ps(second)));
}

#define DAHL_TILE_G(by, size)                                                                                       \
    DAHL_WIDE void dahl_tile_##size##_##by(const dahl_tile_element_t *element, __m512i pair, __m512d g[2])          \
    {                                                                                                               \
        dahl_tile_g_by_##by(element, pair, dahl_tile_##size, g);                                                    \
    }
DAHL_TILE_G(counts, tiny)
DAHL_TILE_G(counts, small)
DAHL_TILE_G(counts, any)
DAHL_TILE_G(angle, tiny)
DAHL_TILE_G(angle, small)
DAHL_TILE_G(angle, any)

DAHL_WIDE void dahl_tile_make_maps(dahl_tiles_t *tiles, int t, const dahl_tile_element_t *element, const void *moves,
                                   dahl_tile_g_t g_of)
{
    __m512i lanes[4];
    __m512d g[DAHL_LANES];
    dahl_tile_load(moves, lanes);
    DAHL_UNROLL_8
    for (int m = 0; m < 4; m++) {
        g_of(element, lanes[m], g + 2 * m);
    }
    DAHL_UNROLL_8
    for (int k = 0; k < DAHL_LANES; k++) {
        __m512d size = _mm512_abs_pd(g[k]);
        tiles->e[t][k] = 1.0 - size;
        tiles->c[t][k] = g[k] - element->w0 * size;
    }
}

DAHL_WIDE void dahl_tile_join(__m512d *before_e, __m512d *before_c, __m512d e, __m512d c)
{
    *before_c = e * *before_c + c;
    *before_e = e * *before_e;
}

/** Shift the lanes up by 1, 2 or 4, and fill with those of `first`. */
DAHL_WIDE __m512d dahl_tile_up(__m512d x, __m512d first, int lanes)
{
    __m512i high = _mm512_castpd_si512(x), low = _mm512_castpd_si512(first);
    return _mm512_castsi512_pd(lanes == 1   ? _mm512_alignr_epi64(high, low, 7)
                               : lanes == 2 ? _mm512_alignr_epi64(high, low, 6)
                                            : _mm512_alignr_epi64(high, low, 4));
}

/** Join the maps of the 8 ticks of a lane in pairs, then those of the lanes before each lane. */
DAHL_WIDE void dahl_tile_join_all(dahl_tiles_t *tiles, int t)
{
    __m512d e[DAHL_LANES], c[DAHL_LANES];
    DAHL_UNROLL_8
    for (int k = 0; k < DAHL_LANES; k++) {
        e[k] = tiles->e[t][k];
        c[k] = tiles->c[t][k];
    }
    DAHL_UNROLL_8
    for (int apart = 1; apart < DAHL_LANES; apart *= 2) {
        DAHL_UNROLL_8
        for (int k = 0; k < DAHL_LANES; k += 2 * apart) {
            dahl_tile_join(&e[k], &c[k], e[k + apart], c[k + apart]);
        }
    }
    e[0] = _mm512_max_pd(e[0], dahl_tile_all(DAHL_LEAST_E));
    DAHL_UNROLL_8
    for (int lanes = 1; lanes < DAHL_LANES; lanes *= 2) {
        __m512d before_e = dahl_tile_up(e[0], dahl_tile_all(1.0), lanes);
        __m512d before_c = dahl_tile_up(c[0], _mm512_setzero_pd(), lanes);
        dahl_tile_join(&before_e, &before_c, e[0], c[0]);
        e[0] = before_e;
        c[0] = before_c;
    }
    tiles->to_e[t] = e[0];
    tiles->to_c[t] = c[0];
}

/** Write the torques. Return d at the end of the tile, from d at its start, in all lanes. */
DAHL_WIDE __m512d dahl_tile_write(const dahl_tiles_t *tiles, int t, const dahl_tile_element_t *element, __m512d d, float *to)
{
    __m256 F[DAHL_LANES];
    __m512d ends = tiles->to_e[t] * d + tiles->to_c[t];
    __m512d now = dahl_tile_up(ends, d, 1);
    DAHL_UNROLL_8
    for (int k = 0; k < DAHL_LANES; k++) {
        now = tiles->e[t][k] * now + tiles->c[t][k];
        F[k] = _mm512_cvtpd_ps(element->Fc * now + element->F0);
    }
    dahl_tile_store(F, to);
    return _mm512_permutexvar_pd(_mm512_set1_epi64(DAHL_LANES - 1), ends);
}

DAHL_WIDE void dahl_tiles_table(double a, double table[DAHL_TABLE_ENTRIES])
{
    const __m512d counts = _mm512_setr_pd(0, 1, 2, 3, 4, 5, 6, 7);
    _mm512_storeu_pd(table, dahl_tile_any(a * counts));
    _mm512_storeu_pd(table + 8, dahl_tile_any(a * (counts + 8.0)));
}

/** Input of a block: an element and its start. */
typedef struct {
    const dahl_throughput_scale_t *scale;
    const double *table;
    double w0;
    const void *moves;
    float *F;
} dahl_tile_job_t;

DAHL_WIDE double dahl_tiles_run(const dahl_tile_job_t *job, dahl_tile_g_t g_of)
{
    const dahl_throughput_scale_t *scale = job->scale;
    const dahl_tile_element_t element = {
        {_mm512_loadu_pd(job->table), _mm512_loadu_pd(job->table + 8)},
        dahl_tile_all(scale->a), dahl_tile_all(job->w0), dahl_tile_all(scale->Fc), dahl_tile_all(scale->Fc * job->w0)};
    __m512d d = _mm512_setzero_pd();
    dahl_tiles_t tiles;
    for (int t = 0; t < DAHL_TILES; t++) {
        dahl_tile_make_maps(&tiles, t, &element, (const unsigned char *)job->moves + 4 * DAHL_TILE_TICKS * t, g_of);
    }
    for (int t = 0; t < DAHL_TILES; t++) {
        dahl_tile_join_all(&tiles, t);
    }
    for (int t = 0; t < DAHL_TILES; t++) {
        d = dahl_tile_write(&tiles, t, &element, d, job->F + DAHL_TILE_TICKS * t);
    }
    return _mm512_cvtsd_f64(d);
}

DAHL_WIDE double dahl_tiles_by_counts(const dahl_tile_job_t *job, uint32_t most)
{
    if (most <= DAHL_TABLE_MOST) {
        return dahl_tiles_run(job, dahl_tile_g_by_table);
    }
    return most <= job->scale->tiny    ? dahl_tiles_run(job, dahl_tile_tiny_counts)
           : most <= job->scale->small ? dahl_tiles_run(job, dahl_tile_small_counts)
                                  : dahl_tiles_run(job, dahl_tile_any_counts);
}

DAHL_WIDE double dahl_tiles_by_angle(const dahl_tile_job_t *job, uint32_t most)
{
    return most <= job->scale->tiny    ? dahl_tiles_run(job, dahl_tile_tiny_angle)
           : most <= job->scale->small ? dahl_tiles_run(job, dahl_tile_small_angle)
                                  : dahl_tiles_run(job, dahl_tile_any_angle);
}

#endif
#endif

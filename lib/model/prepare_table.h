/* SPDX-License-Identifier: MIT */
/*
 * From the travel of one count to a table of g, private. What a small part v = u 2^-n of the travel u of one count leaves of
 * the gap comes from two terms of the series of exp(-v), 1 - v + v^2/2; everything else from joining travels in one direction,
 *     exp(-(x + y)) = exp(-x) exp(-y),
 * which needs no exponential and lets no relative error grow. Relative error of every entry: below 2^-32 (the series
 * 2^-42, the quotient 2^-37, one unit of Q64 at the start, which is 2^-34 of the smallest travel, and one at each join).
 * Each prepare has these functions as its own, so that a firmware with one of them gets them inlined.
 */
#ifndef DAHL_PREPARE_TABLE_H
#define DAHL_PREPARE_TABLE_H

#include "bristle_update.h"

#define DAHL_PART_BITS 20 /* v < 2^-20, so that v^3/6 < 2^-42 v */
#define DAHL_LOG2_E_Q31 3098164010u /* rounded up, which centres the truncation of a/ln 2 to 32 bits */

static inline dahl_real_t dahl_real_of_float(float x)
{
    return dahl_real_of(dahl_bits_of(x));
}

/* a 2^exponent times b, a in (2^62, 2^64). */
static inline DAHL_COLD dahl_wide_t dahl_product(uint64_t a, int32_t exponent, dahl_real_t b)
{
    uint64_t high = dahl_mul((uint32_t)(a >> 32), b.mantissa) + dahl_mulhi((uint32_t)a, b.mantissa);
    return dahl_normalise(high, exponent + b.exponent + 32);
}

/* What travels x and then y leave of the gap, in Q64. The product goes up to the next integer: so it stays above 0, and where
 * there is no travel, 2^64 - 1, it stays as it is. */
static inline uint64_t dahl_join(uint64_t left_by_x, uint64_t left_by_y)
{
    return dahl_mulhi64(left_by_x, left_by_y) + 1;
}

/* What travel u leaves of the gap, in Q64, for u > 2^-31. */
static inline DAHL_COLD uint64_t dahl_left_by(dahl_wide_t u)
{
    for (; u.exponent < -64 - DAHL_PART_BITS; u.exponent++) {
        u.mantissa >>= 1;
    }
    uint32_t v_q51 = (uint32_t)(u.mantissa >> (DAHL_PART_BITS + 13));
    uint64_t left = ~(u.mantissa >> DAHL_PART_BITS) + (dahl_mulhi(v_q51, v_q51) >> 7);
    for (; u.exponent > -64 - DAHL_PART_BITS; u.exponent--) {
        left = dahl_join(left, left);
    }
    return left;
}

static inline void dahl_write_entry(dahl_q64_t *entry, uint64_t g)
{
    entry->hi = (uint32_t)(g >> 32);
    entry->lo = (uint32_t)g;
}

/* 0, 1 .. 8 counts, then twice the one before. */
static inline DAHL_COLD void dahl_write_table(dahl_q64_t *g, int entries, uint64_t left_by_one)
{
    uint64_t left = left_by_one;
    dahl_write_entry(&g[0], 0);
    dahl_write_entry(&g[1], ~left);
    for (int n = 2; n < entries; n++) {
        left = dahl_join(left, n <= DAHL_DIRECT_COUNTS_MAX ? left_by_one : left);
        dahl_write_entry(&g[n], ~left);
    }
}

#endif

/* SPDX-License-Identifier: MIT */
/**
 * Table of g from the travel of one count.
 *
 * For a small travel v = u 2^-n, the series gives the remaining gap exp(-v) = 1 - v + v^2/2. All other entries
 * follow from joining travels, exp(-(x + y)) = exp(-x) exp(-y), by which no relative error grows. The relative
 * error of every entry is below 2^-32: the series 2^-42, the quotient 2^-37, one unit of Q64 at the start (2^-34 of
 * the smallest travel), and one unit at each join.
 *
 * Each prepare function has its own inlined copy of these functions.
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

/** Return a 2^exponent times b, for a in (2^62, 2^64). */
static inline DAHL_COLD dahl_wide_t dahl_product(uint64_t a, int32_t exponent, dahl_real_t b)
{
    uint64_t high = dahl_mul((uint32_t)(a >> 32), b.mantissa) + dahl_mulhi((uint32_t)a, b.mantissa);
    return dahl_normalise(high, exponent + b.exponent + 32);
}

/** Return the gap, in Q64, that remains after travel x and then y. Rounding up keeps it above 0, and keeps 2^64 -
 * 1, which means no travel. */
static inline uint64_t dahl_join(uint64_t after_x, uint64_t after_y)
{
    return dahl_mulhi64(after_x, after_y) + 1;
}

/** Return the gap, in Q64, that remains after travel u > 2^-31. */
static inline DAHL_COLD uint64_t dahl_remaining_after(dahl_wide_t u)
{
    for (; u.exponent < -64 - DAHL_PART_BITS; u.exponent++) {
        u.mantissa >>= 1;
    }
    uint32_t v_q51 = (uint32_t)(u.mantissa >> (DAHL_PART_BITS + 13));
    uint64_t remaining = ~(u.mantissa >> DAHL_PART_BITS) + (dahl_mulhi(v_q51, v_q51) >> 7);
    for (; u.exponent > -64 - DAHL_PART_BITS; u.exponent--) {
        remaining = dahl_join(remaining, remaining);
    }
    return remaining;
}

static inline void dahl_write_entry(dahl_q64_t *entry, uint64_t g)
{
    entry->hi = (uint32_t)(g >> 32);
    entry->lo = (uint32_t)g;
}

/** Write the entries of 0, 1 .. 8 counts, then each for twice the counts of the entry before. */
static inline DAHL_COLD void dahl_write_table(dahl_q64_t *g, int entries, uint64_t remaining_after_one)
{
    uint64_t remaining = remaining_after_one;
    dahl_write_entry(&g[0], 0);
    dahl_write_entry(&g[1], ~remaining);
    for (int n = 2; n < entries; n++) {
        remaining = dahl_join(remaining, n <= DAHL_DIRECT_COUNTS_MAX ? remaining_after_one : remaining);
        dahl_write_entry(&g[n], ~remaining);
    }
}

#endif

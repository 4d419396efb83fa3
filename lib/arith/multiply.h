/* SPDX-License-Identifier: MIT */
/* The products of the library, private: 32 x 32 bits, whole or upper half, and 32 x 64. Cores that multiply to 32 bits only
 * (Cortex-M0) take the same products from multiply_v6m.h; the bits are the same. */
#ifndef DAHL_MULTIPLY_H
#define DAHL_MULTIPLY_H

#include "compiler.h"

#if DAHL_V6M
#include "multiply_v6m.h"
#else

static inline uint64_t dahl_mul(uint32_t a, uint32_t b)
{
    return (uint64_t)a * b;
}

static inline uint32_t dahl_mulhi(uint32_t a, uint32_t b)
{
    return (uint32_t)(((uint64_t)a * b) >> 32);
}

/* A factor of several products, and the upper half of one of them. */
typedef uint32_t dahl_factor_t;

static inline dahl_factor_t dahl_split(uint32_t a)
{
    return a;
}

static inline uint32_t dahl_times(dahl_factor_t f, uint32_t b)
{
    return dahl_mulhi(f, b);
}

/* w + z g for g = high:low in Q64. The low product first, by words: it leaves the sum where a multiply-accumulate takes it. */
static inline uint64_t dahl_add_product(uint64_t w, uint32_t z, uint32_t g_high, uint32_t g_low)
{
    uint32_t low = (uint32_t)w + dahl_mulhi(z, g_low);
    uint32_t high = (uint32_t)(w >> 32) + (low < (uint32_t)w);
    DAHL_KEEP(high);
    return ((uint64_t)high << 32 | low) + dahl_mul(z, g_high);
}

/* w - z g. Signed, so that the compiler keeps the product in one piece; z <= 2^31 and g < 1 keep it below 2^63. */
static inline uint64_t dahl_subtract_product(uint64_t w, uint32_t z, uint32_t g_high, uint32_t g_low)
{
    return (uint64_t)((int64_t)w - (int64_t)(dahl_mul(z, g_high) + dahl_mulhi(z, g_low)));
}

#endif

#endif

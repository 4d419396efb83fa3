/* SPDX-License-Identifier: MIT */
/* Products of 32 x 32 bits, whole or upper half, and of 32 x 64 bits, private. Cores that multiply to 32 bits only
 * (Cortex-M0) make the first from 16-bit products in multiply_v6m.h; the bits are the same. */
#ifndef DAHL_MULTIPLY_H
#define DAHL_MULTIPLY_H

#include "compiler.h"

#if DAHL_V6M
#include "multiply_v6m.h"

/* From the product of the words as they stand: those of a negative factor are too large by 2^32. */
static inline int64_t dahl_mul_signed(int32_t a, int32_t b)
{
    uint32_t too_much = (a < 0 ? (uint32_t)b : 0) + (b < 0 ? (uint32_t)a : 0);
    return (int64_t)(dahl_mul((uint32_t)a, (uint32_t)b) - ((uint64_t)too_much << 32));
}

#else

static inline uint64_t dahl_mul(uint32_t a, uint32_t b)
{
    return (uint64_t)a * b;
}

static inline int64_t dahl_mul_signed(int32_t a, int32_t b)
{
    return (int64_t)a * b;
}

#endif

static inline uint32_t dahl_mulhi(uint32_t a, uint32_t b)
{
    return (uint32_t)(dahl_mul(a, b) >> 32);
}

/* z times the fraction high:low in Q64, truncated. */
static inline uint64_t dahl_mul_fraction(uint32_t z, uint32_t high, uint32_t low)
{
    return dahl_mul(z, dahl_opaque(high)) + dahl_mulhi(z, dahl_opaque(low));
}

#endif

/* SPDX-License-Identifier: MIT */
/**
 * Products of 32 x 32 bits, of their upper half, and of 32 x 64 bits.
 *
 * If the core has only a 32-bit product (Cortex-M0), multiply_v6m.h builds the first from 16-bit products, with the
 * same bits.
 */
#ifndef DAHL_MULTIPLY_H
#define DAHL_MULTIPLY_H

#include "compiler.h"

#if DAHL_V6M
#include "multiply_v6m.h"

/** Unsigned product, then a correction: a negative factor counts 2^32 too much. */
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

/** Return c + y r 2^-32, the product rounded down, for 0 <= y < 2^31. */
static inline uint32_t dahl_add_product(uint32_t c, uint32_t y, uint32_t r)
{
#if DAHL_V6M
    return c + dahl_upper_product(y, r) - (r >> 31 != 0 ? y : 0);
#else
    return c + (uint32_t)(dahl_mul_signed((int32_t)dahl_opaque(y), (int32_t)r) >> 32);
#endif
}

/** Return x >> bits, for bits < 32. In words, if the processor has no 64-bit ones: compilers do not know the limit. */
static inline uint64_t dahl_shift_by_less_than_32(uint64_t x, uint32_t bits)
{
#if defined(__SIZEOF_INT128__)
    return x >> bits;
#else
    uint32_t high = (uint32_t)(x >> 32), low = (uint32_t)x;
    return (uint64_t)(high >> bits) << 32 | (low >> bits | high << 1 << (31 - bits));
#endif
}

/** Return z times the Q64 fraction high:low, truncated. */
static inline uint64_t dahl_mul_fraction(uint32_t z, uint32_t high, uint32_t low)
{
    return dahl_mul(z, dahl_opaque(high)) + dahl_mulhi(z, dahl_opaque(low));
}

#endif

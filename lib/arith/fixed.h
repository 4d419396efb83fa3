/* SPDX-License-Identifier: MIT */
/**
 * Fixed-point arithmetic.
 *
 * Three representations:
 * - Q30, Q62, Q64: the integer i means i 2^-30, i 2^-62, i 2^-64
 * - real: mantissa 2^exponent, 32 bits, top bit set
 * - wide: the same with 64 bits
 */
#ifndef DAHL_FIXED_H
#define DAHL_FIXED_H

#include "compiler.h"
#include "multiply.h"

#define DAHL_ONE_Q30 ((uint32_t)1 << 30)
#define DAHL_ONE_Q62 ((uint64_t)1 << 62)
#define DAHL_TOP_BIT ((uint32_t)1 << 31)

#define DAHL_BITS_SIGN DAHL_TOP_BIT
#define DAHL_BITS_MAGNITUDE UINT32_C(0x7fffffff)
#define DAHL_BITS_INF UINT32_C(0x7f800000)
#define DAHL_BITS_NORMAL UINT32_C(0x00800000) /* smallest normal float */

/** A float and its bits, without a floating-point operation: safe for NaN and with every compiler flag. */
typedef union {
    float value;
    uint32_t bits;
} dahl_float_bits_t;

static inline uint32_t dahl_bits_of(float x)
{
    dahl_float_bits_t as;
    as.value = x;
    return as.bits;
}

static inline float dahl_float_of(uint32_t bits)
{
    dahl_float_bits_t as;
    as.bits = bits;
    return as.value;
}

typedef struct {
    uint32_t mantissa;
    int32_t exponent;
} dahl_real_t;

typedef struct {
    uint64_t mantissa;
    int32_t exponent;
} dahl_wide_t;

static inline dahl_real_t dahl_real_of(uint32_t bits)
{
    dahl_real_t r;
    r.mantissa = DAHL_TOP_BIT | bits << 8;
    r.exponent = (int32_t)(bits >> 23) - (127 + 31);
    return r;
}

/** Return the bits of the float nearest to mantissa 2^exponent, a half rounded up. The mantissa must have its
 * top bit set, and the float must be normal. The top bit, or a carry of the rounding, adds 1 to the exponent
 * field. */
static inline uint32_t dahl_round_to_float(uint32_t mantissa, uint32_t exponent)
{
    return ((exponent + (127 + 31 - 1)) << 23) + (((mantissa >> 7) + 1) >> 1);
}

/** Leading zeros of x > 0, without a helper function of the compiler if the core has no instruction for it. */
#if defined(__GNUC__) && UINT_MAX == 0xffffffff                                                                             \
    && (defined(__ARM_FEATURE_CLZ) || defined(__aarch64__) || defined(__x86_64__) || defined(__i386__)                      \
        || defined(__riscv_zbb) || defined(__XTENSA__))
static inline uint32_t dahl_leading_zeros(uint32_t x)
{
    return (uint32_t)__builtin_clz(x);
}
#else
static inline uint32_t dahl_leading_zeros(uint32_t x)
{
    uint32_t zeros = 0;
    if (x >> 16 == 0) {
        x <<= 16;
        zeros = 16;
    }
    if (x >> 24 == 0) {
        x <<= 8;
        zeros += 8;
    }
    if (x >> 28 == 0) {
        x <<= 4;
        zeros += 4;
    }
    if (x >> 30 == 0) {
        x <<= 2;
        zeros += 2;
    }
    return zeros + 1 - (x >> 31);
}
#endif

static inline dahl_wide_t dahl_normalise(uint64_t mantissa, int32_t exponent)
{
    dahl_wide_t r;
    while (mantissa >> 63 == 0) {
        mantissa <<= 1;
        exponent--;
    }
    r.mantissa = mantissa;
    r.exponent = exponent;
    return r;
}

/* The following functions are out of line (mul_div64.c, ratio.c): for parameters, not for a tick. */

uint64_t dahl_mulhi64(uint64_t a, uint64_t b);

/** Return numerator/denominator in Q63, truncated, in (2^62, 2^64). The top bits of both must be set. */
uint64_t dahl_quotient_q63(uint32_t numerator, uint32_t denominator);

/** Return numerator/denominator in units of 2^-bits, truncated, for numerator <= denominator < 2^63. If both are
 * equal, the result is one unit less. */
uint64_t dahl_quotient(uint64_t numerator, uint64_t denominator, int bits);

/** Return x/y in Q62, rounded, clamped to 1. The lowest bits of both mantissas are ignored. */
uint64_t dahl_ratio_q62(dahl_real_t x, dahl_real_t y);

#endif

/* SPDX-License-Identifier: MIT */
/*
 * The kernel g(u) = 1 - exp(-u), private, integers only. u comes and g goes as mantissa 2^(-32 - shift), the mantissa's top
 * bit set, so that small travel keeps all its bits. g has shift 0 from u = 1/2 on, and the shift of u below.
 *
 *   u = k ln 2 + x, 0 <= x < ln 2     g = 1 - 2^-k (1 - h),   h = 1 - exp(-x) = x - x (x R(x))
 *
 * R is a polynomial of degree 5 with coefficients in Q32 from kernel.sollya (relative error of h: below 2^-31.6, certified
 * there). For k = 0 the last product runs on the mantissa of u itself.
 *
 * DAHL_KERNEL_ERROR bounds the relative error of g over every u that an angle of type float can give.
 */
#ifndef DAHL_KERNEL_H
#define DAHL_KERNEL_H

#include "fixed.h"

#define DAHL_KERNEL_ERROR 0x1p-29 /* relative, u in [2^-63, infinity) */

typedef struct {
    uint32_t mantissa;
    int32_t shift;
} dahl_scaled_t;

#define DAHL_LOG2E_Q31 3098164009u
#define DAHL_LN2_Q32 2977044472u

/* x R(x) in Q32 for x in Q32, x <= ln 2. */
static inline uint32_t dahl_kernel_tail(uint32_t x)
{
    uint32_t r = 632363u;
    r = 5768195u - dahl_mulhi(x, r);
    r = 35701855u - dahl_mulhi(x, r);
    r = 178936099u - dahl_mulhi(x, r);
    r = 715825623u - dahl_mulhi(x, r);
    r = 2147483566u - dahl_mulhi(x, r);
    return dahl_mulhi(x, r);
}

/* u < ln 2: g on the mantissa of u, same shift. */
static inline uint32_t dahl_kernel_small(uint32_t mantissa, uint32_t x)
{
    return mantissa - dahl_mulhi(mantissa, dahl_kernel_tail(x));
}

/* 1/2 <= u < 22.1 = 31.9 ln 2: 0 <= left <= 5. Returns g in Q32. */
static inline uint32_t dahl_kernel_large(uint32_t mantissa, int32_t left)
{
    uint32_t k = dahl_mulhi(mantissa, DAHL_LOG2E_Q31) >> (31 - left);
    uint32_t x = (mantissa << left) - k * DAHL_LN2_Q32; /* modulo 1, so the bits of u above 1 may go */
    DAHL_KEEP_32(x);
    return ~(~dahl_kernel_small(x, x) >> k);
}

/* g(u) for u < 22.1; beyond, 1 - g is below 2^-31.8 and dahl_step takes 1. */
static inline dahl_scaled_t dahl_kernel(dahl_scaled_t u)
{
    dahl_scaled_t g = u;
    if (u.shift <= 0) {
        g.mantissa = dahl_kernel_large(u.mantissa, -u.shift);
        g.shift = 0;
    } else if (u.shift < 29) { /* below 2^-29, g is u within 2^-30 of itself */
        g.mantissa = dahl_kernel_small(u.mantissa, u.mantissa >> u.shift);
    }
    return g;
}

#endif

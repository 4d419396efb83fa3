/* SPDX-License-Identifier: MIT */
/**
 * Kernel: g(u) = 1 - exp(-u) for u = a |dtheta|, in integers.
 *
 * The plan holds a/ln 2, so v = u/ln 2 and g = 1 - 2^-v. v is mantissa 2^(-32 - shift) with the top bit set: small
 * travel keeps all its bits.
 * @verbatim
 *   v < 2^-30    g = v ln 2
 *   v < 1/4      g = v P(4 v), P of degree 4
 *   v < 32       v = k + j/16 + y, 2^-v = 2^-k 2^(-j/16) 2^-y; 2^(-j/16) from a table,
 *                1 - 2^-y = y P(16 y), P of degree 3
 *   otherwise    1 - g is below 2^-32: g = 1
 * @endverbatim
 * Coefficients in Q32: kernel.sollya, which certifies a relative error below 2^-30.6. The last coefficient has few
 * bits and is multiplied by the upper half of Y only.
 *
 * DAHL_KERNEL_ERROR bounds the relative error of g for every a and angle, including the product with a (Sollya and
 * Gappa, tests/proof; all floats were run for a = 1). g has up to 2 more units of 2^-64, for bristle_update.h.
 */
#ifndef DAHL_KERNEL_H
#define DAHL_KERNEL_H

#include "../arith/fixed.h"
#include "dahl.h"

#define DAHL_KERNEL_ERROR 0x1p-29 /* [1] relative; travel below 2^-64 ln 2 counts as none */

typedef struct {
    uint32_t mantissa;
    int32_t shift;
} dahl_scaled_t;

/** Return v = product 2^exponent, truncated, for a product of two mantissas. */
static inline dahl_scaled_t dahl_scaled_of(uint64_t product, int32_t exponent)
{
    dahl_scaled_t v = {(uint32_t)(product >> 32), -64 - exponent};
    if (!(v.mantissa & DAHL_TOP_BIT)) {
        v.mantissa = (uint32_t)(product >> 31);
        v.shift++;
    }
    return v;
}

static inline dahl_scaled_t dahl_travel(const dahl_plan_t *plan, uint32_t magnitude)
{
    dahl_real_t theta = dahl_real_of(magnitude);
    return dahl_scaled_of(dahl_mul(theta.mantissa, plan->a_mantissa), theta.exponent + plan->a_exponent);
}

static inline uint32_t dahl_horner(uint32_t c, uint32_t Y, uint32_t r)
{
    return c - dahl_mulhi(Y, r);
}

/** For 2 <= shift < 32. The OR adds the 2 units that bristle_update.h needs for rounding, except for some g <
 * 2^-31. */
static inline dahl_q64_t dahl_kernel_small(dahl_scaled_t v)
{
    uint32_t Y = v.mantissa >> (v.shift - 2);
    uint32_t r = 644112u - (((Y >> 16) * 20813u) >> 16);
    r = dahl_horner(14898789u, Y, r);
    r = dahl_horner(257941187u, Y, r);
    r = dahl_horner(2977044471u, Y, r);
    uint32_t g = dahl_mulhi(v.mantissa, r);
    dahl_q64_t q = {g >> v.shift, g << (32 - v.shift) | 2u};
    return q;
}

/** For v < 2^-30. Below 2^-64, g is 0. */
static inline dahl_q64_t dahl_kernel_tiny(dahl_scaled_t v)
{
    dahl_q64_t q = {0, 0};
    if (v.shift < 64) {
        q.lo = (dahl_mulhi(v.mantissa, 2977044471u) >> (v.shift - 32)) + 2u;
    }
    return q;
}

/** 1 - 2^(-j/16) in Q33, rounded up, since the following steps truncate. */
static const uint32_t dahl_kernel_table[] = {
    0, 364185046u, 712929841u, 1046889000u, 1366689387u, 1672931286u, 1966189534u, 2247014594u,
    2515933593u, 2773451308u, 3020051117u, 3256195903u, 3482328925u, 3698874649u, 3906239545u, 4104812849u,
};

/** For 1/4 <= v < 32: -5 <= shift < 2. */
static inline dahl_q64_t dahl_kernel_large(dahl_scaled_t v)
{
    uint32_t whole = v.mantissa >> (28 + v.shift), Y = v.mantissa << (4 - v.shift);
    uint32_t k = whole >> 4, h = dahl_kernel_table[whole & 15u];
    uint32_t r = 931096u - (((Y >> 16) * 9912u) >> 16);
    r = dahl_horner(64485290u, Y, r);
    r = dahl_horner(2977044471u, Y, r);
    uint32_t g = h + (dahl_mulhi(~(h >> 1), dahl_mulhi(Y, r)) >> 3);
    dahl_q64_t q = {~(~(g >> 1) >> k), 0};
    return q;
}

static inline dahl_q64_t dahl_kernel(dahl_scaled_t v)
{
    if (v.shift < 2) {
        dahl_q64_t all = {UINT32_MAX, UINT32_MAX};
        return v.shift < -5 ? all : dahl_kernel_large(v);
    }
    return v.shift < 32 ? dahl_kernel_small(v) : dahl_kernel_tiny(v);
}

#endif

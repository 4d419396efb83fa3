/* SPDX-License-Identifier: MIT */
/**
 * Kernel: g(u) = 1 - exp(-u) for u = a |dtheta|, in integers.
 *
 * The plan holds a/ln 2, so v = u/ln 2 and g = 1 - 2^-v. v is mantissa 2^(-32 - shift) with one of its two top bits
 * set: small travel keeps all its bits.
 * @verbatim
 *   Q(f) = (1 - 2^-f)/f     0 <= f < 1: 16 cubics
 *   v < 1                   g = v Q(v)
 *   v < 256                 g = 1 - 2^-k (1 - f Q(f)),  v = k + f
 *   otherwise               g = 1
 * @endverbatim
 * Close to v = 1, the shift of v decides between the first two.
 *
 * DAHL_KERNEL_ERROR bounds the relative error of g for every a and angle, including the product with a (Sollya and
 * Gappa, tests/proof; all floats were run for a = 1). If v < 2^-31, g is also cut to Q64.
 */
#ifndef DAHL_KERNEL_H
#define DAHL_KERNEL_H

#include "bristle_update.h"

#define DAHL_KERNEL_ERROR 0x1p-29 /* [1] relative; travel below 2^-64 ln 2 counts as none */

/** Q(f) = c0 + y (c1 + y (c2 + y c3)), y = f - j/16, in Q32. */
typedef struct {
    int32_t c3, c2, c1;
    uint32_t c0;
} dahl_cubic_t;

#define DAHL_KERNEL_CUBICS 16
extern const dahl_cubic_t dahl_kernel_cubics[DAHL_KERNEL_CUBICS]; /* kernel_table.c */

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

/**
 * Far plans. If a/ln 2 is 2^62 or more, v of a zero angle has the shift of a normal travel. If a/ln 2 is below
 * 2^-121, so has v of an infinite angle. prepare() marks such a plan: it subtracts DAHL_FAR from a_exponent. The shift
 * of v is then never that of a normal travel, so a tick needs no check of the angle. The ticks in assembly find such a
 * shift by its bits, also by those of DAHL_FAR.
 */
#define DAHL_FAR 0x600000

#define DAHL_FAR_SHIFT (DAHL_FAR / 2) /* above the shift of v for a plan that is not far */

static inline int dahl_is_far(int32_t a_exponent)
{
    return (uint32_t)(a_exponent + 152) > 152 + 30; /* not in -152 .. 30 */
}

/** Return the exponent of plan->a_mantissa. */
static inline int32_t dahl_a_exponent(const dahl_plan_t *plan)
{
    return plan->a_exponent + (plan->a_exponent < -DAHL_FAR / 2 ? DAHL_FAR : 0);
}

/** Return v for the bits of an angle, truncated. Only if v < 1 is its top bit shifted to the top. The angle is
 * (2^31 | bits << 8) 2^(field - 158). The upper half of the product of the mantissas is 2^-32 of it, and so is the
 * unit of a mantissa of v: 94 = 158 - 64. */
static inline dahl_scaled_t dahl_travel(uint32_t a_mantissa, int32_t a_exponent, uint32_t bits)
{
    const int32_t field = (int32_t)(bits >> 23 & 255u);
    dahl_scaled_t v = {dahl_mulhi(DAHL_TOP_BIT | bits << 8, a_mantissa), 94 - a_exponent - field};
    if (v.shift >= 0) {
        uint32_t missing = 1 - (v.mantissa >> 31);
        v.mantissa <<= missing;
        v.shift += (int32_t)missing;
    }
    return v;
}

/** Return Q(f) in Q32. The three products are rounded down. */
static inline uint32_t dahl_Q(uint32_t f)
{
    const dahl_cubic_t *c = &dahl_kernel_cubics[f >> 28];
    const uint32_t y = f & 0x0fffffffu;
    uint32_t r = dahl_add_product((uint32_t)c->c2, y, (uint32_t)c->c3);
    r = dahl_add_product((uint32_t)c->c1, y, r);
    return dahl_add_product(c->c0, y, r);
}

/** Return v Q(v), for 0 <= shift < 32 and a mantissa with its top bit set. */
static inline dahl_scaled_t dahl_kernel_small(dahl_scaled_t v)
{
    dahl_scaled_t g = {dahl_mulhi(v.mantissa, dahl_Q(v.mantissa >> v.shift)), v.shift};
    return g;
}

/** Return v Q(0) for v < 2^-32, cut to Q64. */
static inline dahl_scaled_t dahl_kernel_tiny(dahl_scaled_t v)
{
    dahl_scaled_t g = {0, 32};
    if (v.shift < 64) {
        g.mantissa = dahl_mulhi(v.mantissa, dahl_kernel_cubics[0].c0) >> (v.shift - 32);
    }
    return g;
}

/** Return 1 - 2^-k (1 - f Q(f)), for -8 <= shift < 0. The rotation leaves k in the low bits of f, which are 0
 * otherwise. That changes g by at most 0.4 2^-32. */
static inline dahl_scaled_t dahl_kernel_large(dahl_scaled_t v)
{
    uint32_t k = v.mantissa >> (32 + v.shift), f = v.mantissa << -v.shift | k;
    dahl_scaled_t g = {k < 32 ? ~(~dahl_mulhi(f, dahl_Q(f)) >> k) : UINT32_MAX, 0};
    return g;
}

/** Return g(v), with a shift of 0 .. 32. */
static inline dahl_scaled_t dahl_kernel(dahl_scaled_t v)
{
    if (v.shift < 0) {
        dahl_scaled_t one = {UINT32_MAX, 0};
        return v.shift < -8 ? one : dahl_kernel_large(v);
    }
    return DAHL_LIKELY(v.shift < 32) ? dahl_kernel_small(v) : dahl_kernel_tiny(v);
}

/** Return z g, truncated, for a shift below 64. */
static inline uint64_t dahl_mul_scaled(uint32_t z, dahl_scaled_t g)
{
    if (DAHL_LIKELY(g.shift < 32)) {
        return dahl_shift_by_less_than_32(dahl_mul(z, dahl_opaque(g.mantissa)), (uint32_t)g.shift);
    }
    return dahl_mulhi(z, g.mantissa) >> (g.shift - 32);
}

/** The update of bristle_update.h. */
static inline uint64_t dahl_forward_by_angle(uint64_t w, dahl_scaled_t g)
{
    return w + dahl_mul_scaled(dahl_gap_forward(w), g);
}

static inline uint64_t dahl_backward_by_angle(uint64_t w, dahl_scaled_t g)
{
    return w - dahl_mul_scaled(dahl_gap_backward(w), g);
}

#endif

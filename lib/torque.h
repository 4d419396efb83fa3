/* SPDX-License-Identifier: MIT */
/*
 * From the state to N m with one rounding, private: the product of the mantissa of Fc and of w in integers, rounded to
 * the 24 bits of a float at the end. (w to float and then times Fc would round twice.) All 62 bits of w take part, so
 * small torques keep their relative accuracy. Error: half an ulp of the result, plus 2^-31 of it for the bits of w below
 * the 32 kept. Fc >= 2^-64 and |w| >= 2^-62 keep the result a normal float.
 */
#ifndef DAHL_TORQUE_H
#define DAHL_TORQUE_H

#include "bits.h"
#include "fixed.h"

/* The top 32 bits of x, 0 < x < 2^63, and their exponent. */
static inline dahl_real_t dahl_real_of_u63(uint64_t x)
{
    uint32_t hi = (uint32_t)(x >> 32), lo = (uint32_t)x;
    dahl_real_t r;
    int32_t zeros;
    if (hi != 0) {
        zeros = dahl_leading_zeros(hi); /* at least 1 */
        r.mantissa = (hi << zeros) | (lo >> (32 - zeros));
        r.exponent = 32 - zeros;
    } else {
        zeros = dahl_leading_zeros(lo);
        r.mantissa = lo << zeros;
        r.exponent = -zeros;
    }
    return r;
}

/* product 2^exponent rounded to a float's bits; product in [2^62, 2^64), the result a normal float. A carry out of the
 * mantissa raises the exponent by itself. */
static inline uint32_t dahl_round_to_float(uint64_t product, int32_t exponent)
{
    int32_t shift = 39 + (int32_t)(product >> 63);
    uint32_t mantissa = (uint32_t)((product + ((uint64_t)1 << (shift - 1))) >> shift);
    return ((uint32_t)(exponent + shift + 149) << 23) + mantissa;
}

static inline float dahl_torque_of(const dahl_plan_t *plan, int64_t w)
{
    uint32_t sign = w < 0 ? DAHL_BITS_SIGN : 0u;
    uint64_t size = w < 0 ? 0u - (uint64_t)w : (uint64_t)w;
    if (size == 0) {
        return 0.0f;
    }
    dahl_real_t r = dahl_real_of_u63(size);
    uint64_t product = (uint64_t)r.mantissa * plan->Fc_mantissa;
    return dahl_float_of(sign | dahl_round_to_float(product, r.exponent - 62 + plan->Fc_exponent));
}

#endif

/* SPDX-License-Identifier: MIT */
/*
 * From the state to N m with one rounding, private: the product of the mantissa of Fc and of w in integers, rounded to
 * the 24 bits of a float at the end. (w to float and then times Fc would round twice.) All 62 bits of w take part, so
 * small torques keep their relative accuracy. Error: half an ulp of the result. Fc >= 2^-64 and |w| >= 2^-62 keep the
 * result a normal float.
 */
#ifndef DAHL_TORQUE_H
#define DAHL_TORQUE_H

#include "fixed.h"

/* The words (top, next), 0 < top < 2^31, as a float's bits, rounded. The scale is an exponent times 2^24, and 1 for the
 * rounding; a carry out of the mantissa raises the exponent by itself. */
static inline uint32_t dahl_pack(uint32_t top, uint32_t next, uint32_t scale)
{
    uint32_t zeros = (uint32_t)dahl_leading_zeros(top);
    uint32_t mantissa = top << zeros | next >> (32 - zeros);
    return (scale - (zeros << 24) + (mantissa >> 7)) >> 1;
}

/* The same for torques below 2^-30 Fc or so, from a product below 2^64 (small_torque.c). */
float dahl_small_torque(uint64_t product, uint32_t scale, uint32_t sign);

/* Fc_mantissa < 2^32 and |w| <= 2^62 (1 + 2^-30): the product has three words, and the top one is below 2^31. */
static inline float dahl_torque_of(const dahl_plan_t *plan, int64_t w)
{
    uint32_t sign = w < 0 ? DAHL_BITS_SIGN : 0u;
    uint64_t size = (uint64_t)w;
    if (DAHL_LIKELY(w < 0)) { /* as likely as not; so the negation stays in line, not a jump away */
        size = 0u - size;
    }
    uint64_t low = dahl_mul(plan->Fc_mantissa, (uint32_t)size);
    uint64_t high = dahl_mul(plan->Fc_mantissa, (uint32_t)(size >> 32)) + (low >> 32);
    if (high >> 32 == 0) {
        return dahl_small_torque(high << 32 | (uint32_t)low, plan->Fc_scale, sign);
    }
    return dahl_float_of(sign | dahl_pack((uint32_t)(high >> 32), (uint32_t)high, plan->Fc_scale));
}

/* Written out in both branches of a step: joining them first costs more instructions than it saves bytes. */
static inline float dahl_keep(const dahl_plan_t *plan, dahl_state_t *state, uint64_t w)
{
    state->w = (int64_t)w;
    return dahl_torque_of(plan, (int64_t)w);
}

#endif

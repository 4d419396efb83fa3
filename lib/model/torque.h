/* SPDX-License-Identifier: MIT */
/*
 * From the state to N m, private: the 32 bits of w from its first one on, times the mantissa of Fc in integers, rounded to
 * the 24 bits of a float at the end. (w to float and then times Fc would round twice to 24 bits.) So small torques keep
 * their relative accuracy. Two truncations cost less than 2 units of 2^-31 of the result; the plan's mantissa of Fc has half
 * a unit too much, to centre them: in all half an ulp of the result and 0.008 of one.
 * Fc >= 2^-64 and |w| >= 2^-62 keep the result a normal float.
 */
#ifndef DAHL_TORQUE_H
#define DAHL_TORQUE_H

#include "../arith/fixed.h"

/* s 2^-zeros times Fc, s with its top bit set, as a float's bits. Fc_scale is an exponent times 2^24, and 1 for the rounding;
 * a carry out of the mantissa raises the exponent by itself. */
static inline uint32_t dahl_pack(const dahl_plan_t *plan, uint32_t s, uint32_t zeros)
{
    uint32_t product = dahl_mulhi(s, plan->Fc_mantissa);
    uint32_t missing = dahl_leading_zero(product);
    product <<= missing;
    return (plan->Fc_scale - ((zeros + missing) << 24) + (product >> 7)) >> 1;
}

static inline float dahl_torque_here(const dahl_plan_t *plan, uint64_t w)
{
    uint32_t sign = (uint32_t)(w >> 32) & DAHL_BITS_SIGN;
    DAHL_KEEP(sign);
    if (DAHL_LIKELY(sign != 0)) { /* as likely as not; so the negation stays in line, not a jump away */
        w = 0u - w;
    }
    uint32_t top = (uint32_t)(w >> 32), next = (uint32_t)w, zeros;
    if (top != 0) {
        zeros = dahl_leading_zeros(top);
        top = top << zeros | next >> (32 - zeros);
    } else if (next != 0) { /* below 2^-30 Fc */
        zeros = dahl_leading_zeros(next);
        top = next << zeros;
        zeros += 32;
    } else {
        return 0.0f;
    }
    return dahl_float_of(sign | dahl_pack(plan, top, zeros));
}

/* The same by a call (torque.c): one copy for all that need not be quick. */
float dahl_torque_of(const dahl_plan_t *plan, uint64_t w);

#endif

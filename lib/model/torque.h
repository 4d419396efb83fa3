/* SPDX-License-Identifier: MIT */
/**
 * Convert a state to N m.
 *
 * The 32 leading bits of w are multiplied by the mantissa of Fc in integers, and rounded once to the 24 bits of a
 * float. Small torques thus keep their relative accuracy. Two truncations cost less than 2 units of 2^-31 of the
 * result; half a unit is added to the mantissa of Fc to centre them. Total error: 0.508 ulp of the result. Fc is at
 * least 2^-64 and |w| at least 2^-62, so the result is a normal float.
 */
#ifndef DAHL_TORQUE_H
#define DAHL_TORQUE_H

#include "../arith/fixed.h"
#include "dahl.h"

/** Return the bits of the torque s 2^(-30 - zeros) Fc. The top bit of s must be set. */
static inline uint32_t dahl_torque_bits(dahl_real_t Fc, uint32_t s, uint32_t zeros)
{
    uint32_t product = dahl_mulhi(s, Fc.mantissa), missing = 1 - (product >> 31);
    return dahl_round_to_float(product << missing, (uint32_t)Fc.exponent + 2 - zeros - missing);
}

/** Return w Fc, computed inline. The top bit of the mantissa of Fc must be set. */
static inline float dahl_torque_inline(dahl_real_t Fc, uint64_t w)
{
    uint32_t sign = (uint32_t)(w >> 32) & DAHL_BITS_SIGN, high, low, zeros, s;
    w = sign != 0 ? 0u - w : w;
    high = (uint32_t)(w >> 32);
    low = (uint32_t)w;
    if (high != 0) {
        zeros = dahl_leading_zeros(high);
        s = high << zeros | low >> 1 >> (31 - zeros);
    } else if (low != 0) { /* below 2^-30 Fc */
        zeros = dahl_leading_zeros(low);
        s = low << zeros;
        zeros += 32;
    } else {
        return 0.0f;
    }
    return dahl_float_of(sign | dahl_torque_bits(Fc, s, zeros));
}

/** Return w Fc. On ARMv6-M all calls but the ticks in C share one copy of it: torque_from.c or, in assembly,
 * lib/cores/torque_v6m.S. */
#if DAHL_V6M
float dahl_torque_from(dahl_real_t Fc, uint64_t w);
#else
static inline float dahl_torque_from(dahl_real_t Fc, uint64_t w)
{
    return dahl_torque_inline(Fc, w);
}
#endif

/** The OR adds half a unit, since the lowest bit of the mantissa of a float is 0. A plan of all zeros has no
 * torque. */
static inline float dahl_torque_of(const dahl_plan_t *plan, uint64_t w)
{
    dahl_real_t Fc = {plan->Fc_mantissa | 1, plan->Fc_exponent};
    return plan->Fc_mantissa == 0 ? 0.0f : dahl_torque_from(Fc, w);
}

/** Do the same inline, for the ticks in C. */
static inline float dahl_torque_of_inline(const dahl_plan_t *plan, uint64_t w)
{
    dahl_real_t Fc = {plan->Fc_mantissa | 1, plan->Fc_exponent};
    return plan->Fc_mantissa == 0 ? 0.0f : dahl_torque_inline(Fc, w);
}

#endif

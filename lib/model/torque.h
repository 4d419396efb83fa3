/* SPDX-License-Identifier: MIT */
/**
 * @file torque.h
 * @brief Convert a state to N m. Private.
 *
 * The 32 leading bits of w are multiplied by the mantissa of Fc in integers. The product is rounded once to the 24
 * bits of a float, so small torques keep their relative accuracy. (w as a float times Fc would round twice.) Two
 * truncations cost less than 2 units of 2^-31 of the result. Half a unit is added to the mantissa of Fc to centre
 * them. The total error is 0.5 + 0.008 ulp of the result. Since Fc >= 2^-64 and |w| >= 2^-62, the result is a
 * normal float.
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

/** Return w Fc, for w in Q62. */
static inline float dahl_torque_from(dahl_real_t Fc, uint64_t w)
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

/** The lowest bit of the mantissa of a float is 0, so the OR adds half a unit. A plan of all zeros has no
 * torque. */
static inline float dahl_torque_of(const dahl_plan_t *plan, uint64_t w)
{
    dahl_real_t Fc = {plan->Fc_mantissa | 1, plan->Fc_exponent};
    return plan->Fc_mantissa == 0 ? 0.0f : dahl_torque_from(Fc, w);
}

#endif

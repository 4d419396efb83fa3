/* SPDX-License-Identifier: MIT */
/**
 * Any mix of elements on one shaft, in N m.
 *
 * Torques are added before the sum is rounded to a float. The exponent of the sum is that of the largest Fc so far,
 * plus spare bits for the number of parts. A smaller torque is shifted right towards 0, so the opposite motion
 * gives the opposite sum. Fc w has 62 bits: a unit of the sum is 2^-62 of the largest Fc, times at most twice the
 * number of parts.
 */
#include "dahl_parts.h"

#include "../model/bristle_update.h"
#include "part.h"
#include "shift.h"

#define NO_EXPONENT (-1000) /* below the exponent of any Fc */

/** torque 2^(exponent + spare - 30) [N m], in two's complement; spare is constant within a tick */
typedef struct {
    uint64_t torque;
    int32_t exponent; /* exponent of the largest Fc so far */
} sum_t;

/** Return a torque in two's complement in units 2^bits as large, truncated towards 0. */
static uint64_t scale_down(uint64_t torque, uint32_t bits)
{
    return torque >> 63 ? 0u - dahl_shift_right(0u - torque, bits) : dahl_shift_right(torque, bits);
}

/** A plan of all zeros has an Fc of 0 and is ignored. */
static inline sum_t add_torque(sum_t sum, dahl_real_t Fc, uint64_t w, uint32_t spare)
{
    if (Fc.exponent > sum.exponent && Fc.mantissa != 0) {
        sum.torque = scale_down(sum.torque, (uint32_t)(Fc.exponent - sum.exponent));
        sum.exponent = Fc.exponent;
    }
    uint32_t backward = (uint32_t)(w >> 63);
    w = backward ? 0u - w : w;
    uint64_t size = dahl_mul_fraction(Fc.mantissa, (uint32_t)(w >> 32), (uint32_t)w);
    size = dahl_shift_right(size, (uint32_t)(sum.exponent - Fc.exponent) + spare);
    sum.torque = backward ? sum.torque - size : sum.torque + size;
    return sum;
}

static float torque_of(sum_t sum, uint32_t spare)
{
    uint32_t sign = (uint32_t)(sum.torque >> 32) & DAHL_BITS_SIGN, exponent = (uint32_t)sum.exponent + spare + 2;
    uint64_t size = sign != 0 ? 0u - sum.torque : sum.torque;
    uint32_t high = (uint32_t)(size >> 32), low = (uint32_t)size;
    if (high == 0) {
        high = low;
        low = 0;
        exponent -= 32;
    }
    if (high == 0) {
        return 0.0f;
    }
    uint32_t zeros = dahl_leading_zeros(high);
    high = high << zeros | low >> 1 >> (31 - zeros);
    return dahl_float_of(sign | dahl_round_to_float(high, exponent - zeros));
}

float dahl_parallel_step_counts(const dahl_part_t *parts, uint32_t count, int32_t dcounts)
{
    const uint32_t spare = dahl_part_spare_bits(count);
    sum_t sum = {0, NO_EXPONENT};
    for (; count != 0; count--) {
        const dahl_part_t part = *parts++;
        uint64_t w = (uint64_t)part.move(part.plan, part.state, dcounts);
        sum = add_torque(sum, dahl_part_Fc(&part), w, spare);
    }
    return torque_of(sum, spare);
}

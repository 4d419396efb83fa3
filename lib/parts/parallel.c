/* SPDX-License-Identifier: MIT */
/*
 * Any mix of parts on one shaft. Torques are added before anything is rounded to a float. The exponent of the sum is that of the
 * largest Fc so far, and as much more as the number of parts asks for, so that their sum fits; a torque of a smaller exponent is
 * shifted right, towards 0, so that the opposite motion has the opposite sum. Fc w has 62 bits: a unit of the sum is 2^-62 of the
 * largest Fc, times the number of parts or up to twice that.
 */
#include "dahl_parts.h"

#include "../model/bristle_update.h"
#include "part.h"
#include "shift.h"

#define NO_EXPONENT (-1000) /* below that of any Fc */

/* torque 2^(exponent + spare - 30) [N m], in two's complement; spare is the same for all of a tick */
typedef struct {
    uint64_t torque;
    int32_t exponent; /* the largest of Fc so far */
} sum_t;

/* A torque in two's complement in units 2^bits as large, towards 0. */
static uint64_t coarser(uint64_t torque, uint32_t bits)
{
    return torque >> 63 ? 0u - dahl_shifted_right(0u - torque, bits) : dahl_shifted_right(torque, bits);
}

/* The sum and Fc w, for w in Q62. A plan of all zeros has no Fc, and no exponent either. */
static inline sum_t with_torque(sum_t sum, dahl_real_t Fc, uint64_t w, uint32_t spare)
{
    if (Fc.exponent > sum.exponent && Fc.mantissa != 0) {
        sum.torque = coarser(sum.torque, (uint32_t)(Fc.exponent - sum.exponent));
        sum.exponent = Fc.exponent;
    }
    uint32_t backward = (uint32_t)(w >> 63);
    w = backward ? 0u - w : w;
    uint64_t size = dahl_mul_fraction(Fc.mantissa, (uint32_t)(w >> 32), (uint32_t)w);
    size = dahl_shifted_right(size, (uint32_t)(sum.exponent - Fc.exponent) + spare);
    sum.torque = backward ? sum.torque - size : sum.torque + size;
    return sum;
}

/* The float nearest to a sum, a half away from zero. */
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
        sum = with_torque(sum, dahl_part_Fc(&part), w, spare);
    }
    return torque_of(sum, spare);
}

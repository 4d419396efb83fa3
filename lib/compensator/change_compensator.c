/* SPDX-License-Identifier: MIT */
/**
 * New parameters of a compensator or an observer between two ticks.
 *
 * Torques are fractions of Fc, and the speed is one of fade_speed. Each is multiplied by the old unit over the new one.
 * The product is truncated, so a torque never grows. It loses less than one unit, which prepare reserves of the slew.
 */
#include "../arith/fixed.h"
#include "../arith/scale.h"
#include "dahl_compensator.h"

#define CHANGED_SPEED_MAX_Q20 (INT32_C(1) << 30)
#define CHANGED_RESIDUAL_MAX_Q24 ((INT32_C(1) << 30) - 1) /* a difference of two fits 32 bits */
#define PRODUCT_BITS 55 /* of 31 bits and the 24 of a float */
#define PRODUCT_END ((uint64_t)1 << PRODUCT_BITS)

/** Return size 2^shift, truncated; UINT64_MAX from PRODUCT_END on. */
static uint64_t shift_product(uint64_t size, int32_t shift)
{
    if (shift <= 0) {
        return shift > -PRODUCT_BITS ? size >> -shift : 0;
    }
    const int is_long = shift >= PRODUCT_BITS || size >= PRODUCT_END >> shift;
    return size == 0 ? 0 : is_long ? UINT64_MAX : size << shift;
}

/** Return x from/to, truncated, at most INT32_MAX. Both are floats: the lowest 8 bits of a mantissa are 0. Two
 * truncations of a positive number are one. */
static int32_t convert_unit(int32_t x, dahl_real_t from, dahl_real_t to)
{
    const uint64_t denominator = (uint64_t)(to.mantissa >> 8) << 31;
    const int32_t shift = (int32_t)((uint32_t)from.exponent - (uint32_t)to.exponent);
    const uint64_t numerator = shift_product(dahl_mul(dahl_magnitude(x), from.mantissa >> 8), shift);
    const int32_t size = numerator < denominator ? (int32_t)dahl_quotient(numerator, denominator, 31) : INT32_MAX;
    return x < 0 ? -size : size;
}

/** Return a torque in the new unit, 0 if one of the plans is all zeros. */
static int32_t convert_torque(int32_t x, dahl_real_t before, dahl_real_t after)
{
    return before.mantissa == 0 || after.mantissa == 0 ? 0 : convert_unit(x, before, after);
}

/** Keep the distance to the nearer end of the play. */
static int32_t convert_position(int32_t position, int32_t from, int32_t to)
{
    const int32_t above = position < 0 ? 0 : position, low = above < from ? above : from, high = from - low;
    return low <= high ? (low < to ? low : to) : to - (high < to ? high : to);
}

/** Without an old fade over speed, take the speed of the last move. */
static int32_t convert_speed(const dahl_compensator_plan_t *from, const dahl_compensator_plan_t *to,
                             const dahl_compensator_t *compensator)
{
    const dahl_real_t before = {from->fade_mantissa, from->fade_exponent}, after = {to->fade_mantissa, to->fade_exponent};
    if (after.mantissa == 0) {
        return 0;
    }
    if (before.mantissa == 0) {
        return (int32_t)((uint32_t)dahl_limit(compensator->move, (int32_t)to->jump) * to->speed_unit);
    }
    return dahl_limit(convert_unit(compensator->speed_q20, before, after), CHANGED_SPEED_MAX_Q20);
}

void dahl_compensator_change(const dahl_compensator_plan_t *from, const dahl_compensator_plan_t *to,
                             dahl_compensator_t *compensator)
{
    const dahl_real_t before = {from->Fc_mantissa, from->Fc_exponent}, after = {to->Fc_mantissa, to->Fc_exponent};
    int32_t *const torques[] = {&compensator->ratio_q30, &compensator->wanted_q30, &compensator->torque_q30};
    for (int k = 0; k < 3; k++) {
        *torques[k] = convert_torque(*torques[k], before, after);
    }
    compensator->speed_q20 = convert_speed(from, to, compensator);
    compensator->play_position = convert_position(compensator->play_position, from->play, to->play);
}

/** Out of line: the loop over all ticks would otherwise become a memset() for a change to 0. */
static DAHL_OUT_OF_LINE int32_t convert_residual(int32_t x, dahl_real_t before, dahl_real_t after)
{
    return dahl_limit(convert_torque(x, before, after), CHANGED_RESIDUAL_MAX_Q24);
}

/** Convert the upper word of a low-pass; the lower one is below the rounding. */
static int64_t convert_low_pass(int64_t x_q56, dahl_real_t before, dahl_real_t after)
{
    return convert_residual((int32_t)(x_q56 >> 32), before, after) * ((int64_t)1 << 32);
}

/** Forget the last move, because it belongs to the old period. */
void dahl_residual_change(const dahl_residual_plan_t *from, const dahl_residual_plan_t *to, dahl_residual_t *residual)
{
    const dahl_real_t before = {from->Fc_mantissa, from->Fc_exponent}, after = {to->Fc_mantissa, to->Fc_exponent};
    for (int k = 0; k < DAHL_RESIDUAL_TICKS; k++) {
        residual->unexplained_q24[k] = convert_residual(residual->unexplained_q24[k], before, after);
    }
    residual->raw_q56 = convert_low_pass(residual->raw_q56, before, after);
    residual->filtered_q56 = convert_low_pass(residual->filtered_q56, before, after);
    residual->torque_q24 = convert_torque(residual->torque_q24, before, after);
    residual->move = 0;
}

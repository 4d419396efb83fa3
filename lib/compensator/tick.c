/* SPDX-License-Identifier: MIT */
/** Compensator, before and after the tick of its element. */
#include "../arith/compiler.h"
#include "dahl_compensator.h"
#include "scale.h"

#define ONE_Q20 (UINT32_C(1) << 20)
#define ONE_Q30 (UINT32_C(1) << 30)
#define GAIN_MAX_Q16 (3u << 15) /* gain 1 and the clamp 1.5 of the adaptation */

/** The size of this array is invalid if the state has more than 48 bytes. */
typedef char dahl_compensator_has_at_most_48_bytes[sizeof(dahl_compensator_t) <= 48 ? 1 : -1];

/** Hold the torque for the first bad ticks, then fade out. The speed is kept, so that a fault at high speed does not
 * look like rest. */
static int32_t reject(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator)
{
    compensator->bad_ticks += compensator->bad_ticks != UINT32_MAX;
    compensator->rejected += compensator->rejected != UINT32_MAX;
    if (compensator->bad_ticks >= DAHL_COMPENSATOR_BAD_TICKS) {
        compensator->fade_q30 -= dahl_least(compensator->fade_q30, plan->fall_q30);
    }
    compensator->move = 0;
    return 0;
}

/** Return the part of the move that leaves the play. Unsigned sums: any play_position is safe. */
static int32_t apply_play(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator, int32_t dcounts)
{
    int32_t position = (int32_t)((uint32_t)compensator->play_position + (uint32_t)dcounts);
    int32_t end = position > plan->play_high ? plan->play_high : position;
    end = end < plan->play_low ? plan->play_low : end;
    compensator->play_position = end;
    return (int32_t)((uint32_t)position - (uint32_t)end);
}

int32_t dahl_compensator_move(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator, int32_t dcounts,
                              int is_good)
{
    if (!is_good || dahl_magnitude(dcounts) > plan->jump) {
        return reject(plan, compensator);
    }
    int32_t move = apply_play(plan, compensator, dcounts);
    uint32_t speed = dahl_least(dahl_magnitude(move), plan->speed_counts) * plan->speed_unit;
    compensator->speed_q20 += (speed >> plan->speed_shift) - (compensator->speed_q20 >> plan->speed_shift);
    compensator->fade_q30 = dahl_least(compensator->fade_q30 + plan->rise_q30, ONE_Q30);
    compensator->bad_ticks = 0;
    compensator->move = move;
    return move;
}

/** Return 1 up to fade_speed, then a line to 0 at twice fade_speed. */
static uint32_t speed_fade_q15(uint32_t speed_q20)
{
    return dahl_least(2 * ONE_Q20 - dahl_least(speed_q20, 2 * ONE_Q20), ONE_Q20) >> 5;
}

/** Return gain, fade and fade over speed as one factor. A gain out of range shows a corrupt state. */
static uint32_t factor_q16(const dahl_compensator_plan_t *plan, const dahl_compensator_t *compensator)
{
    uint32_t gain = plan->gain_q16 + (uint32_t)compensator->gain_change_q16;
    gain = gain <= GAIN_MAX_Q16 ? gain : plan->gain_q16;
    uint32_t fade = dahl_least(compensator->fade_q30, ONE_Q30) >> 15;
    return (gain * fade >> 15) * compensator->speed_fade_q15 >> 15;
}

/** Return the torque nearest to wanted that differs from now by at most slew. */
static int32_t limit_slew(int32_t now, int32_t wanted, uint32_t slew)
{
    if (wanted > now) {
        return (int32_t)((uint32_t)now + dahl_least((uint32_t)wanted - (uint32_t)now, slew));
    }
    return (int32_t)((uint32_t)now - dahl_least((uint32_t)now - (uint32_t)wanted, slew));
}

int32_t dahl_compensator_torque(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator, int32_t ratio_q30)
{
    compensator->ratio_q30 = ratio_q30;
    compensator->speed_fade_q15 = speed_fade_q15(compensator->speed_q20);
    int32_t wanted = dahl_scale_and_limit(ratio_q30, factor_q16(plan, compensator), plan->limit_q30);
    int32_t torque = limit_slew(compensator->torque_q30, wanted, plan->slew_q30);
    torque = torque < plan->limit_q30 ? torque : plan->limit_q30; /* from a corrupt state only */
    torque = torque > -plan->limit_q30 ? torque : -plan->limit_q30;
    compensator->wanted_q30 = wanted;
    compensator->torque_q30 = torque;
    return torque;
}

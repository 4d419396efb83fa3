/* SPDX-License-Identifier: MIT */
/** Compensator, before and after the tick of its element. */
#include "../arith/compiler.h"
#include "../arith/scale.h"
#include "dahl_compensator.h"

#define ONE_Q20 (INT32_C(1) << 20)
#define ONE_Q30 (UINT32_C(1) << 30)

/** The size of this array is invalid if the state has more than 48 bytes. */
typedef char dahl_compensator_has_at_most_48_bytes[sizeof(dahl_compensator_t) <= 48 ? 1 : -1];

/** Use no move. Hold the torque for the first bad readings, then fade out. The speed is kept, so that a fault at high
 * speed does not look like rest. */
static int32_t hold_torque(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator)
{
    uint32_t fade = dahl_least(compensator->fade_q30, ONE_Q30);
    fade -= compensator->bad_ticks < DAHL_COMPENSATOR_BAD_TICKS ? 0 : dahl_least(fade, plan->fall_q30);
    compensator->fade_q30 = fade;
    compensator->move = 0;
    return 0;
}

static int32_t reject_reading(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator)
{
    compensator->bad_ticks += compensator->bad_ticks != UINT32_MAX;
    compensator->rejected += compensator->rejected != UINT32_MAX;
    compensator->needs_start = 1;
    return hold_torque(plan, compensator);
}

/** Set the start of the next move. bad_ticks stays, so that good and bad readings in turn fade out too. */
static int32_t start_move(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator)
{
    compensator->needs_start = 0;
    return hold_torque(plan, compensator);
}

/** Return the part of the move that leaves the play. Unsigned sums: any play_position is safe. */
static int32_t apply_play(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator, int32_t dcounts)
{
    int32_t position = (int32_t)((uint32_t)compensator->play_position + (uint32_t)dcounts);
    int32_t end = position < 0 ? 0 : position;
    end = end < plan->play ? end : plan->play;
    compensator->play_position = end;
    return (int32_t)((uint32_t)position - (uint32_t)end);
}

/** Round the change of the mean towards 0, so that opposite motions have opposite speeds. Prepare bounds the product: a
 * longer move is a jump. */
static void update_mean_speed(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator, int32_t move)
{
    uint32_t speed = (uint32_t)compensator->speed_q20, gap = (uint32_t)move * plan->speed_unit - speed;
    uint32_t is_negative = (uint32_t)((int32_t)gap >> 31); /* 0, or all bits */
    gap += is_negative & plan->speed_mask;
    compensator->speed_q20 = (int32_t)(speed + (uint32_t)((int32_t)gap >> plan->speed_shift));
}

/** Prepare bounds the jump to 2^30. The unsigned sum wraps for a longer move of either sign. */
static int is_rejected_move(int32_t dcounts, uint32_t jump)
{
    return (uint32_t)dcounts + jump > 2 * jump;
}

/** A move after a rejected reading may begin at a wrong count. It is used within the play only: if the caller did not store
 * the rejected reading, the noise then stays within the play. */
int32_t dahl_compensator_move(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator, int32_t dcounts,
                              int is_good)
{
    if (!is_good || is_rejected_move(dcounts, plan->jump)) {
        return reject_reading(plan, compensator);
    }
    int32_t move = apply_play(plan, compensator, dcounts);
    if (compensator->needs_start != 0) {
        return start_move(plan, compensator);
    }
    update_mean_speed(plan, compensator, move);
    compensator->fade_q30 = dahl_least(compensator->fade_q30 + plan->rise_q30, ONE_Q30);
    compensator->bad_ticks = 0;
    compensator->move = move;
    return move;
}

/** Return 1 up to fade_speed, then a line to 0 at twice fade_speed. */
static uint32_t speed_fade_q15(int32_t speed_q20)
{
    int32_t left = (int32_t)(2 * (uint32_t)ONE_Q20 - dahl_magnitude(speed_q20));
    left = left < 0 ? 0 : left;
    return (uint32_t)(left < ONE_Q20 ? left : ONE_Q20) >> 5;
}

/**
 * The limit comes last, so that it also holds if the state is corrupt.
 *
 * Each factor is rounded down, and so are both products. In units of 2^-15, and with factors of at most 1, gain_q16
 * loses 1/2, each fade 1, and each product 1/2: 3.5, DAHL_COMPENSATOR_ERROR. A search reached 3.451.
 */
int32_t dahl_compensator_torque(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator, int32_t ratio_q30)
{
    uint32_t speed_fade = speed_fade_q15(compensator->speed_q20);
    uint32_t factor_q16 = (plan->gain_q16 * (compensator->fade_q30 >> 15) >> 15) * speed_fade >> 15;
    int32_t wanted = dahl_scale_q16(ratio_q30, factor_q16);
    int32_t torque = dahl_approach(compensator->torque_q30, wanted, plan->slew_q30);
    torque = dahl_limit(torque, plan->limit_q30);
    compensator->ratio_q30 = ratio_q30;
    compensator->speed_fade_q15 = speed_fade;
    compensator->wanted_q30 = wanted;
    compensator->torque_q30 = torque;
    return torque;
}

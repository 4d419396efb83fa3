/* SPDX-License-Identifier: MIT */
/** Stage 3: a torque cycle below the friction, without the loop.
 *
 * The torque over the travel of the angle is the presliding stiffness, with the shaft in series. The torque is exact, and the
 * noise of the encoder does not shake the axis. */
#include "commission.h"

#define CYCLE_HZ 2.0f
#define CYCLES 4u
#define SETTLING_CYCLES 1u /* not evaluated: the bristles settle */
#define PHASES 16u         /* bins of a cycle */
#define CYCLE_SHARE 0.55f  /* torque of the cycle over Fc */
#define RETRY_SHARE 0.75f  /* of the torque, after a breakaway */
#define MAX_TRIES 3
#define BREAKAWAY_RAD 0.15f

static void start_cycle(dahl_commission_t *axis)
{
    const float *friction = &axis->table.friction[DAHL_COMMISSION_BINS / 2];
    axis->middle_Fc = dahl_smaller(friction[0], friction[-1]);
    if (!(axis->cycle_torque > 0)) {
        axis->cycle_torque = CYCLE_SHARE * axis->middle_Fc;
    }
    for (uint32_t phase = 0; phase < PHASES; phase++) {
        axis->work.cycle.sum[phase] = 0;
        axis->work.cycle.samples[phase] = 0;
    }
    axis->work.cycle.start = axis->theta;
    axis->work.cycle.rotor[0] = 1;
    axis->work.cycle.rotor[1] = 0;
    dahl_small_turn(AXIS_TWO_PI * CYCLE_HZ * axis->config.period, axis->work.cycle.turn);
    dahl_next_step(axis);
}

/** Evaluate one phase in each tick. The tick after the last one ends the stage. */
static void evaluate_phase(dahl_commission_t *axis, uint32_t phase)
{
    if (phase == PHASES) {
        axis->cycle_travel = axis->work.cycle.high - axis->work.cycle.low;
        dahl_enter(axis, DAHL_COMMISSION_BREAKAWAY);
        dahl_return_to_middle(axis);
        return;
    }
    const float mean = axis->work.cycle.sum[phase] / (float)axis->work.cycle.samples[phase];
    axis->work.cycle.low = phase == 0 ? mean : dahl_smaller(axis->work.cycle.low, mean);
    axis->work.cycle.high = phase == 0 ? mean : dahl_larger(axis->work.cycle.high, mean);
}

static void try_weaker(dahl_commission_t *axis)
{
    axis->cycle_torque *= RETRY_SHARE;
    if (++axis->tries > MAX_TRIES) {
        dahl_refuse(axis, DAHL_COMMISSION_COARSE);
        return;
    }
    dahl_return_to_middle(axis);
}

void dahl_cycle_tick(dahl_commission_t *axis)
{
    const uint32_t period = dahl_ticks(axis, 1 / CYCLE_HZ), tick = axis->step_ticks;
    if (axis->step == 0) {
        if (dahl_wait_in_middle(axis, 0.15f)) {
            start_cycle(axis);
        }
        return;
    }
    axis->step_ticks++;
    if (tick >= CYCLES * period) {
        evaluate_phase(axis, tick - CYCLES * period);
        return;
    }
    float rise = dahl_smaller(1, (float)tick / (float)period), moved = axis->theta - axis->work.cycle.start;
    dahl_rotate(axis->work.cycle.rotor, axis->work.cycle.turn);
    axis->command.torque = dahl_commission_load(axis, 0) + axis->cycle_torque * rise * axis->work.cycle.rotor[1];
    if (dahl_absolute(moved) > BREAKAWAY_RAD) {
        try_weaker(axis);
        return;
    }
    if (tick >= SETTLING_CYCLES * period) {
        uint32_t phase = tick % period * PHASES / period;
        axis->work.cycle.sum[phase] += moved;
        axis->work.cycle.samples[phase]++;
    }
}

/* SPDX-License-Identifier: MIT */
/** Check limits, saturation, tracking, sign, frozen encoder and time in each tick. The first check that fails refuses. */
#include "commission.h"

#define SATURATED_SHARE 0.98f  /* of the limit */
#define SATURATED_S 0.03f
#define HOLD_RAD 0.05f         /* tracking error while a falling axis is held */
#define SOFT_SHARE 0.4f        /* tracking error over the travel: see dahl_stroke_to() */
#define BACKWARD_RAD 0.012f    /* against the first command */
#define FROZEN_S 0.01f
#define FROZEN_PUSH_S 0.006f
#define FROZEN_SHARE 0.6f      /* of Fc: the bristles give way before */
#define FROZEN_BRISTLE_COUNTS 5.0f
#define FROZEN_RAD 0.06f       /* of the reference without a count */
#define FROZEN_PUSH_RAD 0.01f
#define FROZEN_COUNTS 6.0f     /* of a coarse encoder, more */
#define GUESSED_PUSH 120.0f    /* rad/s2 as a torque, before Fc is known */
#define LONGER_PER_RAD 2.86f   /* of the times: a travel beyond 0.35 rad takes longer */
#define TORQUE_ROUNDING 1.001f

static const float most_seconds[] = {3, 25, 12, 12, 20, 60}; /* by stage */

/** Return the change of the torque that must bring a count. In a slow ramp, it is that of some counts, below FROZEN_SHARE. */
static float frozen_torque(const dahl_commission_t *axis)
{
    const float most = FROZEN_SHARE * axis->result.Fc.best, count = axis->config.theta_per_count;
    if (axis->command.stage != DAHL_COMMISSION_BREAKAWAY) {
        return most;
    }
    return dahl_smaller(most, FROZEN_BRISTLE_COUNTS * count * 2 * axis->cycle_torque / axis->cycle_travel);
}

/** Return 1 if the torque grows but no count comes, in the modes TORQUE and OFF. */
static int is_frozen_in_torque(dahl_commission_t *axis, int32_t dcounts)
{
    if (dcounts != 0 || axis->command.mode == DAHL_COMMISSION_OFF || !(axis->result.Fc.best > 0)) {
        axis->watch.torque = axis->torque;
    }
    if (dahl_absolute(axis->torque - axis->watch.torque) <= frozen_torque(axis)) {
        axis->watch.frozen_ticks = 0;
        return 0;
    }
    return ++axis->watch.frozen_ticks > dahl_ticks(axis, FROZEN_S) + axis->watch.count_ticks;
}

/** Return 1 if the reference moves, and the torque with it, but no count comes, in the mode TRACK. */
static int is_frozen_in_loop(dahl_commission_t *axis, int32_t dcounts)
{
    const float Fc = axis->result.Fc.best;
    if (dcounts != 0) {
        axis->watch.frozen_ticks = 0;
        axis->watch.angle = axis->command.angle;
        axis->watch.torque = axis->torque;
        return 0;
    }
    float moved = dahl_absolute(axis->command.angle - axis->watch.angle);
    float grown = dahl_absolute(axis->torque - axis->watch.torque);
    int is_pushed = grown > (Fc > 0 ? FROZEN_SHARE * Fc : GUESSED_PUSH * axis->config.inertia);
    axis->watch.frozen_ticks++;
    return dahl_is_longer(axis, axis->watch.frozen_ticks, is_pushed ? FROZEN_PUSH_S : FROZEN_S)
           && moved > (is_pushed ? FROZEN_PUSH_RAD : FROZEN_RAD) + FROZEN_COUNTS * axis->config.theta_per_count;
}

/** Start the sweeps again, with pushes, because the loop is too soft for the friction. */
static void become_soft(dahl_commission_t *axis)
{
    axis->is_soft = 1;
    axis->torque = 0;
    dahl_enter(axis, DAHL_COMMISSION_SWEEPS);
    axis->stage_ticks = 1;
}

/** Return 1 if the first stroke moves the axis backward: the motor has the wrong sign. */
static int is_backward(const dahl_commission_t *axis)
{
    const int is_first = axis->command.stage == DAHL_COMMISSION_SWEEPS && !(axis->table.level[0] > 0);
    const int is_stroke = is_first && axis->work.sweeps.stroke == 0 && !axis->is_fast;
    return is_stroke && !axis->is_held && axis->theta < -BACKWARD_RAD - FALL_RAD;
}

static dahl_commission_refusal_t check_loop(dahl_commission_t *axis, int32_t dcounts)
{
    const float error = dahl_absolute(axis->command.angle - axis->theta), travel = axis->config.travel;
    const int may_soften = axis->command.stage == DAHL_COMMISSION_SWEEPS && !axis->is_soft;
    if (is_backward(axis)) {
        return DAHL_COMMISSION_SIGN;
    }
    if (may_soften && error > SOFT_SHARE * travel) {
        become_soft(axis);
        return DAHL_COMMISSION_OK;
    }
    if (error > (axis->command.stage == DAHL_COMMISSION_REST ? HOLD_RAD : travel)) {
        return DAHL_COMMISSION_TRACKING;
    }
    return is_frozen_in_loop(axis, dcounts) && !axis->is_soft ? DAHL_COMMISSION_ENCODER : DAHL_COMMISSION_OK;
}

/** Check the limits of angle, speed, torque and time. */
static dahl_commission_refusal_t check_limits(dahl_commission_t *axis)
{
    const dahl_commission_config_t *config = &axis->config;
    const float torque = dahl_absolute(axis->torque);
    int is_saturated = torque >= SATURATED_SHARE * axis->command.torque_limit;
    axis->watch.saturated_ticks = is_saturated ? axis->watch.saturated_ticks + 1 : 0;
    if (!(dahl_absolute(axis->theta) <= config->angle_limit)) {
        return DAHL_COMMISSION_ANGLE;
    }
    if (!(dahl_absolute(axis->speed) <= config->speed_limit)) {
        return DAHL_COMMISSION_SPEED;
    }
    if (!(torque <= TORQUE_ROUNDING * config->torque_limit)) {
        return DAHL_COMMISSION_UNLIMITED;
    }
    if (dahl_is_longer(axis, axis->watch.saturated_ticks, SATURATED_S)) {
        return DAHL_COMMISSION_SATURATED;
    }
    const float seconds = most_seconds[axis->command.stage] * dahl_larger(1, LONGER_PER_RAD * config->travel);
    int is_late = dahl_is_longer(axis, axis->stage_ticks, seconds);
    return is_late ? DAHL_COMMISSION_TIMEOUT : DAHL_COMMISSION_OK;
}

void dahl_supervise(dahl_commission_t *axis, int32_t dcounts)
{
    dahl_commission_refusal_t why = check_limits(axis);
    if (why == DAHL_COMMISSION_OK && axis->command.mode == DAHL_COMMISSION_TRACK) {
        why = check_loop(axis, dcounts);
    } else if (why == DAHL_COMMISSION_OK && is_frozen_in_torque(axis, dcounts)) {
        why = DAHL_COMMISSION_ENCODER;
    }
    if (why != DAHL_COMMISSION_OK) {
        dahl_refuse(axis, why);
    }
}

/* SPDX-License-Identifier: MIT */
/** Motions of the stages: strokes that accelerate, cruise and brake, and the way to the middle. */
#include "commission.h"

#define PUSH_RATE 8.0f     /* Fc/s */
#define FIRST_RATE 0.25f   /* of the torque limit in 1/s, before Fc is known */
#define FREE_RAD 0.01f     /* a push ends if the axis moved by this */
#define STUCK_RAD 0.05f    /* tracking error */
#define STUCK_SPEED 0.1f   /* rad/s */
#define RETURN_SPEED 1.0f         /* rad/s */
#define RETURN_ACCELERATION 20.0f /* rad/s2 */

void dahl_track_from_here(dahl_commission_t *axis)
{
    axis->command.mode = DAHL_COMMISSION_TRACK;
    axis->command.torque = 0;
    axis->command.angle = axis->theta;
    axis->command.speed = 0;
    axis->command.acceleration = 0;
    axis->watch.frozen_ticks = 0;
    axis->watch.angle = axis->theta;
}

/** Push the axis without the loop, because a soft loop breaks it away late. The loop then starts with that torque. */
static void start_push(dahl_commission_t *axis)
{
    axis->command.mode = DAHL_COMMISSION_TORQUE;
    axis->command.torque = axis->torque;
    axis->stroke.is_push = 1;
    axis->stroke.tick = 0;
    axis->stroke.start = axis->theta;
}

/** Plan a stroke in whole ticks. It ends exactly, at a speed slightly below the wanted one. A short stroke has no cruise. */
static void plan_stroke(dahl_commission_t *axis, float end, float speed, float acceleration)
{
    const float period = axis->config.period;
    float way = end - axis->command.angle, length = dahl_absolute(way);
    uint32_t ramp = (uint32_t)(speed / (acceleration * period)) + 1, cruise = 0;
    if ((float)ramp * period * speed > length) {
        ramp = (uint32_t)(dahl_root(length / acceleration) / period) + 1;
    } else {
        cruise = (uint32_t)(length / (speed * period)) - ramp;
    }
    axis->stroke.speed = way / (period * (float)(ramp + cruise));
    axis->stroke.acceleration = axis->stroke.speed / ((float)ramp * period);
    axis->stroke.end = end;
    axis->stroke.ramp_ticks = ramp;
    axis->stroke.cruise_ticks = cruise;
    axis->stroke.tick = 0;
    axis->command.speed = 0;
    axis->command.acceleration = 0;
}

void dahl_stroke_to(dahl_commission_t *axis, float end, float speed, float acceleration)
{
    axis->stroke.end = end;
    axis->stroke.want_speed = speed;
    axis->stroke.want_acceleration = acceleration;
    if (axis->is_soft) {
        start_push(axis);
    } else {
        plan_stroke(axis, end, speed, acceleration);
    }
}

/** Raise the torque of a push until the axis moves, then plan the stroke. */
static void push_tick(dahl_commission_t *axis)
{
    const float Fc = dahl_larger(axis->table.level[0], axis->result.Fc.best);
    const float rate = Fc > 0 ? PUSH_RATE * Fc : FIRST_RATE * axis->config.torque_limit;
    const float direction = axis->stroke.end < axis->stroke.start ? -1.0f : 1.0f;
    axis->command.torque += direction * rate * axis->config.period;
    if (direction * (axis->theta - axis->stroke.start) > FREE_RAD) {
        axis->stroke.is_push = 0;
        dahl_track_from_here(axis);
        plan_stroke(axis, axis->stroke.end, axis->stroke.want_speed, axis->stroke.want_acceleration);
    }
}

int dahl_stroke_tick(dahl_commission_t *axis)
{
    if (axis->stroke.is_push) {
        push_tick(axis);
        return 0;
    }
    const float error = dahl_absolute(axis->command.angle - axis->theta);
    if (axis->is_soft && error > STUCK_RAD && dahl_absolute(axis->speed) < STUCK_SPEED) {
        start_push(axis);
        return 0;
    }
    const float period = axis->config.period;
    dahl_commission_command_t *command = &axis->command;
    uint32_t tick = axis->stroke.tick++, brake = axis->stroke.ramp_ticks + axis->stroke.cruise_ticks;
    if (tick >= brake + axis->stroke.ramp_ticks) {
        command->angle = axis->stroke.end;
        command->speed = 0;
        command->acceleration = 0;
        return 1;
    }
    float acceleration = tick < axis->stroke.ramp_ticks ? axis->stroke.acceleration
                         : tick < brake                 ? 0
                                                        : -axis->stroke.acceleration;
    command->angle += (command->speed + 0.5f * acceleration * period) * period;
    command->speed += acceleration * period;
    command->acceleration = acceleration;
    return 0;
}

void dahl_return_to_middle(dahl_commission_t *axis)
{
    if (axis->command.mode != DAHL_COMMISSION_TRACK) {
        dahl_track_from_here(axis);
    }
    dahl_stroke_to(axis, 0, RETURN_SPEED, RETURN_ACCELERATION);
    axis->step = 0;
    axis->step_ticks = 0;
}

/** Wait without the loop, because the integrator of a loop hunts on an axis that sticks. */
int dahl_wait_in_middle(dahl_commission_t *axis, float seconds)
{
    if (axis->command.mode == DAHL_COMMISSION_TRACK || axis->stroke.is_push) {
        if (dahl_stroke_tick(axis)) {
            axis->command.mode = DAHL_COMMISSION_TORQUE;
            axis->command.torque = dahl_commission_load(axis, 0);
            axis->step_ticks = 0;
        }
        return 0;
    }
    return ++axis->step_ticks > dahl_ticks(axis, seconds);
}

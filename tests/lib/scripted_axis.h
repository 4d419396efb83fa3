/* SPDX-License-Identifier: MIT */
/* An axis without dynamics, to show each reaction of a commissioning. It follows the reference of the loop exactly. Without
 * the loop, the torque bends its bristles, or slides it at a constant speed. A script changes the motion or the torque. */
#ifndef TEST_SCRIPTED_AXIS_H
#define TEST_SCRIPTED_AXIS_H

#include <math.h>
#include <string.h>

#include "dahl_commission.h"

typedef struct scripted {
    double Fc, sigma0, breakaway, load, inertia, slide; /* N m, N m/rad, 1, N m, kg m2, rad/s of an axis that slides */
    double loop_inertia;                                /* kg m2 of the configuration */
    double period, count, travel;
    void (*script)(struct scripted *axis); /* after each tick; may be NULL */
    /* motion */
    dahl_commission_command_t command;
    double theta, anchor, torque, acceleration; /* rad, angle of the bristles without torque, N m, rad/s2 of the last tick */
    int32_t counts, noise;                      /* count; the noise is added to the counts */
    int direction, strokes; /* sign of the last speed, strokes of the loop */
    uint32_t ticks;         /* of the stage */
    uint32_t kick_ticks;    /* since the loop went off in the stage KICK */
    int kicks;              /* times that it went off */
    double push_s, most_push_s; /* s that it slides in this kick, and at most */
    double memory;          /* of the script */
} scripted_t;

static const scripted_t scripted_default = {.Fc = 0.5,
                                            .sigma0 = 100,
                                            .breakaway = 1,
                                            .load = 0.1,
                                            .inertia = 0.002,
                                            .slide = 1,
                                            .loop_inertia = 0.002,
                                            .period = 1e-3,
                                            .count = 9.587e-5,
                                            .travel = 0.35,
                                            .direction = 1};

static inline void follow_reference(scripted_t *axis)
{
    const int direction = axis->command.speed > 0 ? 1 : axis->command.speed < 0 ? -1 : axis->direction;
    axis->strokes += direction != axis->direction;
    axis->direction = direction;
    axis->theta = (double)axis->command.angle;
    axis->torque = axis->load + direction * axis->Fc + axis->inertia * axis->acceleration;
    axis->acceleration = (double)axis->command.acceleration;
}

static inline void follow_torque(scripted_t *axis)
{
    const double rest = (double)axis->command.torque - axis->load, most = axis->breakaway * axis->Fc;
    axis->torque = (double)axis->command.torque;
    if (fabs(rest) > most) {
        axis->push_s += axis->period;
        axis->anchor += copysign(axis->slide * axis->period, rest);
    }
    axis->theta = axis->anchor + fmax(-most, fmin(most, rest)) / axis->sigma0;
}

static inline void count_ticks(scripted_t *axis, uint8_t stage)
{
    const int is_same = axis->command.stage == stage;
    const int is_kick = axis->command.stage == DAHL_COMMISSION_KICK && axis->command.mode == DAHL_COMMISSION_TORQUE;
    axis->ticks = is_same ? axis->ticks + 1 : 0;
    axis->strokes = is_same && axis->command.mode == DAHL_COMMISSION_TRACK ? axis->strokes : 0;
    axis->kick_ticks = is_kick ? axis->kick_ticks + 1 : 0;
    axis->kicks += axis->kick_ticks == 1;
    axis->push_s = is_kick ? axis->push_s : 0;
    axis->most_push_s = fmax(axis->most_push_s, axis->push_s);
}

/* Apply a command for one tick. Return the counts moved. */
static inline int32_t scripted_tick(scripted_t *axis)
{
    if (axis->command.mode == DAHL_COMMISSION_TRACK) {
        follow_reference(axis);
    } else {
        follow_torque(axis);
    }
    if (axis->script != NULL) {
        axis->script(axis);
    }
    if (axis->command.mode == DAHL_COMMISSION_TRACK) {
        axis->anchor = axis->theta - axis->direction * axis->Fc / axis->sigma0;
    }
    const int32_t last = axis->counts;
    axis->counts = (int32_t)floor(axis->theta / axis->count + 0.5) + axis->noise;
    return axis->counts - last;
}

/* Commission the axis for 100 s at most. */
static inline dahl_commission_t commission_scripted(scripted_t *axis)
{
    dahl_commission_t state;
    const dahl_commission_config_t config = {.period = (float)axis->period,
                                             .theta_per_count = (float)axis->count,
                                             .inertia = (float)axis->loop_inertia,
                                             .travel = (float)axis->travel,
                                             .angle_limit = 2 * (float)axis->travel,
                                             .speed_limit = 10,
                                             .torque_limit = 5};
    int32_t moved = 0;
    if (dahl_commission_start(&state, &config) != DAHL_COMMISSION_OK) {
        return state;
    }
    for (uint32_t tick = 0; tick < 100 / axis->period && state.command.stage < DAHL_COMMISSION_DONE; tick++) {
        const uint8_t stage = axis->command.stage;
        dahl_commission_tick(&state, moved, (float)axis->torque, &axis->command);
        count_ticks(axis, stage);
        moved = scripted_tick(axis);
    }
    return state;
}

#endif

/* SPDX-License-Identifier: MIT */
/* One axis in floats, light enough for a small core: a rotor with Dahl's friction, a constant load, a delay of one tick and a
 * position loop. */
#ifndef TEST_PLAIN_AXIS_H
#define TEST_PLAIN_AXIS_H

#include "dahl_commission.h"

enum { PLAIN_SUBSTEPS = 8 };
#define PLAIN_PERIOD 1e-3f   /* s */
#define PLAIN_COUNT 9.587e-5f /* rad: 16 bits */
#define PLAIN_INERTIA 0.002f /* kg m2 */
#define PLAIN_FC 0.5f        /* N m */
#define PLAIN_SIGMA0 100.0f  /* N m/rad */
#define PLAIN_LOAD 0.1f      /* N m */
#define PLAIN_BAND 220.0f    /* rad/s */

typedef struct {
    float theta, speed, bristle, integral, command, acting;
    int32_t counts;
    uint8_t mode;
} plain_axis_t;

static const dahl_commission_config_t plain_config = {.period = PLAIN_PERIOD,
                                                      .theta_per_count = PLAIN_COUNT,
                                                      .inertia = 1.2f * PLAIN_INERTIA,
                                                      .travel = 0.35f,
                                                      .angle_limit = 0.7f,
                                                      .speed_limit = 10,
                                                      .torque_limit = 10 * PLAIN_FC};

/* Return the torque of the position loop. */
static inline float plain_loop(plain_axis_t *axis, const dahl_commission_command_t *to)
{
    const float gain = PLAIN_INERTIA * PLAIN_BAND;
    float error = to->angle - (float)axis->counts * PLAIN_COUNT;
    float wanted = PLAIN_BAND / 5 * error + to->speed - axis->speed;
    if (axis->mode != DAHL_COMMISSION_TRACK) {
        axis->integral = axis->command - gain * wanted;
    }
    axis->integral += gain * PLAIN_BAND / 6 * wanted * PLAIN_PERIOD;
    float torque = axis->integral + gain * wanted + PLAIN_INERTIA * to->acceleration;
    return torque > to->torque_limit ? to->torque_limit : torque < -to->torque_limit ? -to->torque_limit : torque;
}

/* Apply a command for one tick. Return the counts moved. */
static inline int32_t plain_axis_tick(plain_axis_t *axis, const dahl_commission_command_t *to)
{
    const float dt = PLAIN_PERIOD / (float)PLAIN_SUBSTEPS;
    float command = to->mode == DAHL_COMMISSION_TRACK ? plain_loop(axis, to) : to->torque;
    axis->acting = axis->command;
    axis->command = command;
    axis->mode = to->mode;
    for (int k = 0; k < PLAIN_SUBSTEPS; k++) {
        float moved = axis->speed * dt, slip = (moved < 0 ? -moved : moved) * PLAIN_SIGMA0 / PLAIN_FC;
        axis->bristle = (axis->bristle + PLAIN_SIGMA0 * moved) / (1 + slip); /* implicit Euler: at most Fc */
        axis->theta += moved;
        axis->speed += dt * (axis->acting - axis->bristle - PLAIN_LOAD) / PLAIN_INERTIA;
    }
    int32_t before = axis->counts;
    axis->counts = (int32_t)(axis->theta / PLAIN_COUNT + 100000) - 100000;
    return axis->counts - before;
}

#endif

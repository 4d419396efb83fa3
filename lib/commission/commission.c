/* SPDX-License-Identifier: MIT */
/** Start, run and end a commissioning. */
#include "commission.h"

#define SPEED_HZ 40.0f   /* of the speed that is limited */
#define MOST_COUNTS 2e9f /* that the counts hold */

/** The size of this array is invalid if the state has more than 1 kB. */
typedef char dahl_commission_has_at_most_1_kb[sizeof(dahl_commission_t) <= 1024 ? 1 : -1];

void dahl_refuse(dahl_commission_t *axis, dahl_commission_refusal_t why)
{
    axis->command.refusal = (int8_t)why;
    axis->command.stage = DAHL_COMMISSION_REFUSED;
    axis->command.mode = DAHL_COMMISSION_OFF;
    axis->command.torque = 0;
    axis->command.speed = 0;
    axis->command.acceleration = 0;
}

static void clear(void *from, uint32_t size)
{
    for (uint32_t i = 0; i < size; i++) {
        ((uint8_t *)from)[i] = 0;
    }
}

void dahl_enter(dahl_commission_t *axis, dahl_commission_stage_t stage)
{
    axis->command.stage = (uint8_t)stage;
    axis->stage_ticks = 0;
    axis->step_ticks = 0;
    axis->step = 0;
    axis->pass = 0;
    clear(&axis->work, sizeof axis->work);
}

void dahl_next_step(dahl_commission_t *axis)
{
    axis->command.mode = axis->command.stage == DAHL_COMMISSION_INERTIA ? DAHL_COMMISSION_TRACK : DAHL_COMMISSION_TORQUE;
    axis->step++;
    axis->step_ticks = 0;
}

/** Return 1 for a finite x of at least `least` and at most `most`. */
static int is_within(float x, float least, float most)
{
    return x >= least && x <= most;
}

dahl_commission_refusal_t dahl_commission_start(dahl_commission_t *axis, const dahl_commission_config_t *config)
{
    clear(axis, sizeof *axis);
    axis->config = *config;
    axis->command.torque_limit = config->torque_limit;
    int is_valid = is_within(config->period, 5e-5f, 2e-3f) && is_within(config->theta_per_count, 1e-9f, 0.01f)
                   && config->angle_limit <= MOST_COUNTS * config->theta_per_count
                   && is_within(config->inertia, 1e-9f, 1e9f) && is_within(config->travel, 0.2f, 3)
                   && is_within(config->angle_limit, 1.5f * config->travel, 100)
                   && is_within(config->speed_limit, 5, 1000) && is_within(config->torque_limit, 1e-9f, 1e9f);
    axis->command.stage = DAHL_COMMISSION_REST;
    if (!is_valid) {
        dahl_refuse(axis, DAHL_COMMISSION_PARAM);
        axis->command.torque_limit = 0;
        return DAHL_COMMISSION_PARAM;
    }
    return DAHL_COMMISSION_OK;
}

void dahl_commission_abort(dahl_commission_t *axis)
{
    if (axis->command.stage < DAHL_COMMISSION_DONE) {
        dahl_refuse(axis, DAHL_COMMISSION_ABORTED);
    }
}

/** Divide once, in the first tick. */
static void find_speed_units(dahl_commission_t *axis)
{
    axis->count_speed = axis->config.theta_per_count / axis->config.period;
    axis->speed_share = dahl_low_pass_share(SPEED_HZ, axis->config.period);
}

static void read_inputs(dahl_commission_t *axis, int32_t dcounts, float torque)
{
    if (axis->ticks == 0) {
        find_speed_units(axis);
    }
    const float speed = (float)dcounts * axis->count_speed;
    axis->counts = (int32_t)((uint32_t)axis->counts + (uint32_t)dcounts);
    axis->theta = (float)axis->counts * axis->config.theta_per_count;
    axis->speed += axis->speed_share * (speed - axis->speed);
    axis->torque = torque;
    axis->ticks++;
    axis->stage_ticks++;
}

static void stage_tick(dahl_commission_t *axis, int32_t dcounts)
{
    switch (axis->command.stage) {
    case DAHL_COMMISSION_REST:
        dahl_rest_tick(axis);
        break;
    case DAHL_COMMISSION_SWEEPS:
        dahl_sweeps_tick(axis);
        break;
    case DAHL_COMMISSION_CYCLE:
        dahl_cycle_tick(axis);
        break;
    case DAHL_COMMISSION_BREAKAWAY:
        dahl_breakaway_tick(axis);
        break;
    case DAHL_COMMISSION_INERTIA:
        dahl_inertia_tick(axis, dcounts);
        break;
    case DAHL_COMMISSION_KICK:
        dahl_kick_tick(axis, dcounts);
        break;
    default:
        break;
    }
}

dahl_commission_stage_t dahl_commission_tick(dahl_commission_t *axis, int32_t dcounts, float torque,
                                             dahl_commission_command_t *command)
{
    if (axis->command.stage < DAHL_COMMISSION_DONE) {
        read_inputs(axis, dcounts, torque);
        dahl_supervise(axis, dcounts);
        stage_tick(axis, dcounts);
        axis->command.torque = dahl_axis_clamp(axis->command.torque, axis->command.torque_limit);
    }
    *command = axis->command;
    return (dahl_commission_stage_t)axis->command.stage;
}

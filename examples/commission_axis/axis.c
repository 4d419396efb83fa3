/* SPDX-License-Identifier: MIT */
#include "axis.h"

#define TWO_PI 6.2831853f
#define SPEED_FILTER_HZ 150.0f
#define RISE_S 0.5f /* the compensator fades in slowly enough for a hand on the emergency stop */

dahl_commission_refusal_t axis_start(axis_t *axis, const dahl_commission_config_t *config, float loop_hz)
{
    const float rate = TWO_PI * loop_hz, filter = TWO_PI * SPEED_FILTER_HZ * config->period;
    *axis = (axis_t){.kp = rate / 5, .kd = config->inertia * rate, .speed_share = filter / (1 + filter)};
    axis->ki = axis->kd * rate / 6 * config->period;
    return dahl_commission_start(&axis->commission, config);
}

/* A cascade of angle and speed with feed-forward of the inertia. Its integral stops at the limit. */
static float track(axis_t *axis, const dahl_commission_command_t *to, int is_first)
{
    float asked = axis->kp * (to->angle - axis->angle) + to->speed - axis->speed;
    if (is_first) {
        axis->integral = axis->torque - axis->kd * asked; /* the torque does not jump */
    }
    float integral = axis->integral + axis->ki * asked;
    float torque = integral + axis->kd * asked + axis->commission.config.inertia * to->acceleration;
    if (torque > to->torque_limit || torque < -to->torque_limit) {
        return torque > 0 ? to->torque_limit : -to->torque_limit;
    }
    axis->integral = integral;
    return torque;
}

/* Prepare the compensator with the result. If the library rejects it, the torque stays 0. */
static void start_compensation(axis_t *axis)
{
    dahl_compensator_params_t params;
    int is_prepared = dahl_commission_params(&axis->commission, &params, 0) == DAHL_COMPENSATOR_OK;
    params.rise = RISE_S;
    axis->is_compensating = is_prepared && dahl_prepare(&axis->friction, &params.friction) == DAHL_OK
                            && dahl_compensator_prepare(&axis->plan, &params) == DAHL_COMPENSATOR_OK;
    axis->Fc = params.friction.Fc;
}

static float commission(axis_t *axis, int32_t dcounts, int is_good)
{
    uint8_t last_mode = axis->command.mode;
    if (!is_good) {
        dahl_commission_abort(&axis->commission);
    }
    if (dahl_commission_tick(&axis->commission, dcounts, axis->torque, &axis->command) == DAHL_COMMISSION_DONE) {
        start_compensation(axis);
    }
    return axis->command.mode == DAHL_COMMISSION_TRACK ? track(axis, &axis->command, last_mode != DAHL_COMMISSION_TRACK)
                                                       : axis->command.torque;
}

static float compensate(axis_t *axis, int32_t dcounts, int is_good)
{
    int32_t move = dahl_compensator_move(&axis->plan, &axis->compensator, dcounts, is_good);
    int32_t ratio = dahl_step_counts_q30(&axis->friction, &axis->bristle, move);
    ratio = dahl_compensator_torque(&axis->plan, &axis->compensator, ratio);
    return (float)ratio * DAHL_Q30 * axis->Fc + dahl_commission_load(&axis->commission, axis->angle);
}

float axis_tick(axis_t *axis, int32_t dcounts, int is_good)
{
    const dahl_commission_config_t *config = &axis->commission.config;
    float speed = (float)dcounts * config->theta_per_count / config->period;
    axis->counts += dcounts;
    axis->angle = (float)axis->counts * config->theta_per_count;
    axis->speed += axis->speed_share * (speed - axis->speed);
    axis->torque = axis->is_compensating ? compensate(axis, dcounts, is_good) : commission(axis, dcounts, is_good);
    return axis->torque;
}

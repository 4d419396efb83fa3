/* SPDX-License-Identifier: MIT */
/** Check the bounds of a compensator exactly, and convert its parameters to integers. */
#include "../model/check_params.h"
#include "dahl_compensator.h"
#include "real.h"

#define SPEED_MEAN_S 0.012f /* 2 to 3 counts of a 12-bit encoder at 1 rad/s */
#define SPEED_SHIFT_MAX 12
#define FINE_COUNTS ((float)DAHL_COMPENSATOR_FINE_COUNTS)
#define COARSE_SPEED_Q20 ((UINT32_C(1) << 20) / DAHL_COMPENSATOR_FINE_COUNTS)
#define ONE_Q16 (UINT32_C(1) << 16)
#define LIMIT_MAX INT32_MAX
#define ELASTIC_LENGTHS_LOG2 2 /* 4 length_long */

static int is_measured(const dahl_compensator_params_t *params)
{
    return params->law == DAHL_COMPENSATOR_MEASURED;
}

/** Only the measured law needs the axis. */
static DAHL_COLD int32_t check_axis(const dahl_compensator_params_t *params)
{
    return dahl_check_value(params->sigma0_high, 0) | dahl_check_value(params->load, 1) | dahl_check_value(params->inertia, 0)
        | dahl_check_value(params->delay, 0);
}

static DAHL_COLD dahl_compensator_err_t check_values(const dahl_compensator_params_t *params)
{
    const int is_reference = params->law == DAHL_COMPENSATOR_REFERENCE;
    int32_t err = dahl_check_params_by_counts(&params->friction);
    err |= is_reference || is_measured(params) ? DAHL_OK : DAHL_ERR_PARAM;
    err |= dahl_check_value(params->Fc_low, is_reference) | dahl_check_value(params->length_long, is_reference);
    err |= is_measured(params) ? check_axis(params) : DAHL_OK;
    err |= dahl_check_value(params->gain, 1) | dahl_check_value(params->limit, 0) | dahl_check_value(params->slew, 0);
    err |= dahl_check_value(params->period, 0) | dahl_check_value(params->rise, 1) | dahl_check_value(params->fall, 1);
    err |= dahl_check_value(params->fade_speed, 1);
    err |= params->jump > 0 ? DAHL_OK : DAHL_ERR_PARAM;
    return dahl_compensator_code_of(err);
}

/** Return the speed of one count per tick over fade_speed in Q20; 0 without a fade over speed. A number of few bits is
 * rounded up: rounded down, the fade of a fine encoder would start late, or never. */
static uint32_t speed_unit(const dahl_compensator_params_t *params)
{
    if (dahl_is_zero(params->fade_speed)) {
        return 0;
    }
    uint32_t unit = dahl_real_speed_unit(dahl_real_of_param(params->fade_speed), dahl_real_of_param(params->period),
                                         dahl_real_of_param(params->friction.theta_per_count));
    return unit < COARSE_SPEED_Q20 ? unit + 1 : unit;
}

/** Return the largest change in a tick, rounded down, and one unit less: dahl_compensator_change() may round the torque
 * by one. */
static uint32_t slew_step_q30(const dahl_compensator_params_t *params)
{
    dahl_real_t step = dahl_real_multiply(dahl_real_of_param(params->slew), dahl_real_of_param(params->period));
    uint32_t step_q30 = dahl_real_to_fixed(dahl_real_divide(step, dahl_real_of_param(params->friction.Fc)), 30, UINT32_MAX);
    return step_q30 > 0 ? step_q30 - 1 : 0;
}

/** The jump is below DAHL_COMPENSATOR_JUMP_SPEEDS times the counts of a tick at fade_speed. Both products are exact, since
 * floats have 24 bits. The product of jump and speed_unit is then below 2^30. */
static DAHL_COLD int is_jump_below_speeds(const dahl_compensator_params_t *params)
{
    const dahl_real_t theta = dahl_real_of_param(params->friction.theta_per_count), fine = dahl_real_of_param(FINE_COUNTS);
    const dahl_real_t speed = dahl_real_of_param(params->fade_speed), period = dahl_real_of_param(params->period);
    const int32_t is_fine = dahl_real_is_product_above(speed, period, dahl_real_multiply(theta, fine));
    const uint32_t eighth = (period.mantissa >> 8) * (DAHL_COMPENSATOR_JUMP_SPEEDS / 8);
    const int32_t exponent = period.exponent + 8 + speed.exponent + 3 - is_fine;
    dahl_wide_t most = dahl_normalise(dahl_mul(eighth, speed.mantissa), exponent);
    dahl_wide_t jump = dahl_normalise(dahl_mul(params->jump, theta.mantissa), theta.exponent);
    return dahl_wide_is_above(most, jump);
}

static int is_jump_in_range(const dahl_compensator_params_t *params)
{
    return dahl_is_zero(params->fade_speed) ? params->jump <= DAHL_COMPENSATOR_JUMP_MAX
                                            : params->jump < DAHL_COMPENSATOR_JUMP_MAX && is_jump_below_speeds(params);
}

static int is_in_range(const dahl_compensator_params_t *params)
{
    return dahl_bits_of(params->gain) << 1 <= dahl_bits_of(1.0f) << 1 && params->play <= DAHL_COMPENSATOR_PLAY_MAX
        && params->noise <= DAHL_COMPENSATOR_PLAY_MAX / 2 && slew_step_q30(params) > 0 && is_jump_in_range(params);
}

/** 20 gain Fc > 19 (Fc_low - load), with the difference rounded down. */
static int is_gain_above_net_bound(const dahl_compensator_params_t *params, dahl_real_t gain, dahl_real_t Fc)
{
    dahl_real_t net = dahl_real_of_param(params->Fc_low);
    if (dahl_bits_of(params->load) << 1 >= dahl_bits_of(params->Fc_low) << 1) {
        return 1;
    }
    if (!dahl_is_zero(params->load)) {
        net = dahl_real_subtract_down(net, dahl_real_of_param(params->load));
    }
    const uint64_t torque = dahl_mul(20 * (gain.mantissa >> 8), Fc.mantissa >> 8);
    return dahl_wide_is_above(dahl_normalise(torque, gain.exponent + Fc.exponent + 16),
                              dahl_normalise(dahl_mul(19, net.mantissa), net.exponent));
}

/** With the measured law, the bound is 0.95 (Fc_low - load). */
static int is_gain_above_bound(const dahl_compensator_params_t *params)
{
    if (dahl_is_zero(params->Fc_low) || dahl_is_zero(params->gain)) {
        return 0;
    }
    const dahl_real_t gain = dahl_real_of_param(params->gain), Fc = dahl_real_of_param(params->friction.Fc);
    return is_measured(params) ? is_gain_above_net_bound(params, gain, Fc)
                               : dahl_real_is_product_above(gain, Fc, dahl_real_of_param(params->Fc_low));
}

/** The next shorter length decides, because sigma0 = Fc/length_long may have been rounded up. */
static int is_slope_above_bound(const dahl_compensator_params_t *params)
{
    dahl_real_t length = dahl_real_of(dahl_bits_of(params->length_long) - 1);
    length.exponent += is_measured(params) && params->elastic ? ELASTIC_LENGTHS_LOG2 : 0;
    return !dahl_is_zero(params->length_long)
        && dahl_real_is_product_above(dahl_real_of_param(params->friction.sigma0), length,
                                      dahl_real_of_param(params->friction.Fc));
}

/** sigma0_high (delay + period/2)^2 > 3 inertia, with the time rounded up. */
static int is_inertia_below_bound(const dahl_compensator_params_t *params)
{
    const dahl_real_t three = {UINT32_C(3) << 30, -30}, sigma0_high = dahl_real_of_param(params->sigma0_high);
    dahl_real_t half_period = dahl_real_of_param(params->period);
    half_period.exponent--;
    const dahl_real_t late = dahl_real_add_up(dahl_real_of_param(params->delay), half_period);
    return dahl_real_is_product_above(sigma0_high, dahl_real_square_up(late),
                                      dahl_real_multiply(dahl_real_of_param(params->inertia), three));
}

static dahl_compensator_err_t check_params(const dahl_compensator_params_t *params)
{
    dahl_compensator_err_t err = check_values(params);
    if (err != DAHL_COMPENSATOR_OK) {
        return err;
    }
    if (!is_in_range(params)) {
        return DAHL_COMPENSATOR_RANGE;
    }
    if (is_gain_above_bound(params)) {
        return DAHL_COMPENSATOR_GAIN;
    }
    if (is_slope_above_bound(params)) {
        return DAHL_COMPENSATOR_SLOPE;
    }
    if (params->play < 1 || params->play < 2 * params->noise) {
        return DAHL_COMPENSATOR_PLAY;
    }
    return is_measured(params) && is_inertia_below_bound(params) ? DAHL_COMPENSATOR_INERTIA : DAHL_COMPENSATOR_OK;
}

/** Return the step of a fade that lasts `time`. */
static uint32_t fade_step_q30(dahl_real_t period, float time)
{
    if (dahl_is_zero(time)) {
        return DAHL_ONE_Q30;
    }
    uint32_t step = dahl_real_to_fixed(dahl_real_divide(period, dahl_real_of_param(time)), 30, DAHL_ONE_Q30);
    return step > 0 ? step : 1;
}

static DAHL_COLD void write_compensator_plan(dahl_compensator_plan_t *plan, const dahl_compensator_params_t *params)
{
    const dahl_real_t Fc = dahl_real_of_param(params->friction.Fc), period = dahl_real_of_param(params->period);
    const dahl_real_t fade = dahl_real_of_param(params->fade_speed);
    plan->law = (uint8_t)params->law;
    plan->Fc_mantissa = Fc.mantissa;
    plan->Fc_exponent = Fc.exponent;
    plan->fade_mantissa = dahl_is_zero(params->fade_speed) ? 0 : fade.mantissa;
    plan->fade_exponent = fade.exponent;
    plan->gain_q16 = dahl_is_zero(params->gain) ? 0 : dahl_real_to_fixed(dahl_real_of_param(params->gain), 16, ONE_Q16);
    plan->limit_q30 =
        (int32_t)dahl_real_to_fixed(dahl_real_divide(dahl_real_of_param(params->limit), Fc), 30, LIMIT_MAX);
    plan->slew_q30 = slew_step_q30(params);
    plan->rise_q30 = fade_step_q30(period, params->rise);
    plan->fall_q30 = fade_step_q30(period, params->fall);
    plan->jump = params->jump;
    plan->play = (int32_t)params->play;
    plan->speed_unit = speed_unit(params);
    plan->speed_shift = dahl_real_doublings(SPEED_MEAN_S, period, SPEED_SHIFT_MAX);
    plan->speed_mask = (UINT32_C(1) << plan->speed_shift) - 1;
}

DAHL_COLD dahl_compensator_err_t dahl_compensator_prepare(dahl_compensator_plan_t *plan,
                                                          const dahl_compensator_params_t *params)
{
    dahl_compensator_err_t err = check_params(params);
    if (err == DAHL_COMPENSATOR_OK) {
        write_compensator_plan(plan, params);
    }
    return err;
}

/* SPDX-License-Identifier: MIT */
/** Check the bounds of a compensator exactly, and convert its parameters to integers. */
#include "../model/check_params.h"
#include "dahl_compensator.h"
#include "real.h"

#define SPEED_MEAN_S 0.012f /* 2 to 3 counts of a 12-bit encoder at 1 rad/s */
#define SPEED_SHIFT_MAX 12
#define PULL_SHIFT_MAX 30 /* bits of a ratio */
#define SQRT2_Q31 3037000500u
#define TWO_PI 6.2831855f
#define COARSE_SPEED_Q20 ((UINT32_C(1) << 20) / DAHL_COMPENSATOR_FINE_COUNTS)
#define ONE_Q16 (UINT32_C(1) << 16)
#define LIMIT_MAX INT32_MAX

/** The OR of several codes is the most severe one. */
static DAHL_COLD int32_t check_value(float value, int may_be_zero)
{
    const uint32_t bits = dahl_bits_of(value);
    if (dahl_is_zero(value)) {
        return may_be_zero ? DAHL_COMPENSATOR_OK : DAHL_COMPENSATOR_PARAM;
    }
    if (bits >= DAHL_BITS_INF) { /* infinite, NaN, or negative */
        return DAHL_COMPENSATOR_PARAM;
    }
    return dahl_bits_of(DAHL_TORQUE_MIN) <= bits && bits < dahl_bits_of(DAHL_TORQUE_MAX) ? DAHL_COMPENSATOR_OK
                                                                                      : DAHL_COMPENSATOR_RANGE;
}

static DAHL_COLD int32_t check_values(const dahl_compensator_params_t *params)
{
    const int is_reference = params->law == DAHL_COMPENSATOR_REFERENCE;
    int32_t err = dahl_check_params_by_counts(&params->friction);
    err |= is_reference || params->law == DAHL_COMPENSATOR_MEASURED ? DAHL_COMPENSATOR_OK : DAHL_COMPENSATOR_PARAM;
    err |= check_value(params->Fc_low, is_reference) | check_value(params->length_long, is_reference);
    err |= check_value(params->gain, 1) | check_value(params->limit, 0) | check_value(params->slew, 0) | check_value(params->period, 0);
    err |= check_value(params->rise, 1) | check_value(params->fall, 1) | check_value(params->fade_speed, 1) | check_value(params->pull, 1);
    return err | (params->jump > 0 ? DAHL_COMPENSATOR_OK : DAHL_COMPENSATOR_PARAM);
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

static int is_in_range(const dahl_compensator_params_t *params)
{
    return dahl_bits_of(params->gain) << 1 <= dahl_bits_of(1.0f) << 1 && params->play <= DAHL_COMPENSATOR_PLAY_MAX
        && params->noise <= DAHL_COMPENSATOR_PLAY_MAX / 2 && params->jump <= DAHL_COMPENSATOR_JUMP_MAX
        && dahl_mul(params->jump, speed_unit(params)) < DAHL_ONE_Q30;
}

static int is_gain_above_bound(const dahl_compensator_params_t *params)
{
    return !dahl_is_zero(params->Fc_low) && !dahl_is_zero(params->gain)
        && dahl_real_is_product_above(dahl_real_of_param(params->gain), dahl_real_of_param(params->friction.Fc),
                                      dahl_real_of_param(params->Fc_low));
}

/** The next shorter length decides, because sigma0 = Fc/length_long may have been rounded up. */
static int is_slope_above_bound(const dahl_compensator_params_t *params)
{
    const dahl_real_t length = dahl_real_of(dahl_bits_of(params->length_long) - 1);
    return !dahl_is_zero(params->length_long)
        && dahl_real_is_product_above(dahl_real_of_param(params->friction.sigma0), length,
                                      dahl_real_of_param(params->friction.Fc));
}

static dahl_compensator_err_t check_params(const dahl_compensator_params_t *params)
{
    int32_t err = check_values(params);
    if (err != DAHL_COMPENSATOR_OK) {
        return (dahl_compensator_err_t)err;
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
    return params->play < 1 || params->play < 2 * params->noise ? DAHL_COMPENSATOR_PLAY : DAHL_COMPENSATOR_OK;
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

static uint32_t slew_step_q30(dahl_real_t period, float slew, dahl_real_t Fc)
{
    dahl_real_t step = dahl_real_divide(dahl_real_multiply(dahl_real_of_param(slew), period), Fc);
    uint32_t step_q30 = dahl_real_to_fixed(step, 30, UINT32_MAX);
    return step_q30 > 0 ? step_q30 : 1;
}

/** Return the exponent of 2 nearest to that of 1/(2 pi pull period). */
static uint8_t pull_shift(const dahl_compensator_params_t *params, dahl_real_t period)
{
    if (dahl_is_zero(params->pull)) {
        return 0;
    }
    dahl_real_t angle = dahl_real_multiply(dahl_real_of_param(params->pull), dahl_real_of_param(TWO_PI));
    dahl_real_t part = dahl_real_multiply(angle, period);
    int32_t shift = -(part.exponent + 31) - (part.mantissa > SQRT2_Q31);
    return (uint8_t)(shift < 1 ? 1 : shift > PULL_SHIFT_MAX ? PULL_SHIFT_MAX : shift);
}

static DAHL_COLD void write_compensator_plan(dahl_compensator_plan_t *plan, const dahl_compensator_params_t *params)
{
    const dahl_real_t Fc = dahl_real_of_param(params->friction.Fc), period = dahl_real_of_param(params->period);
    plan->law = (uint8_t)params->law;
    plan->gain_q16 = dahl_is_zero(params->gain) ? 0 : dahl_real_to_fixed(dahl_real_of_param(params->gain), 16, ONE_Q16);
    plan->limit_q30 =
        (int32_t)dahl_real_to_fixed(dahl_real_divide(dahl_real_of_param(params->limit), Fc), 30, LIMIT_MAX);
    plan->slew_q30 = slew_step_q30(period, params->slew, Fc);
    plan->rise_q30 = fade_step_q30(period, params->rise);
    plan->fall_q30 = fade_step_q30(period, params->fall);
    plan->jump = params->jump;
    plan->play = (int32_t)params->play;
    plan->speed_unit = speed_unit(params);
    plan->speed_shift = dahl_real_doublings(SPEED_MEAN_S, period, SPEED_SHIFT_MAX);
    plan->speed_mask = (UINT32_C(1) << plan->speed_shift) - 1;
    plan->pull_shift = pull_shift(params, period);
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

/* SPDX-License-Identifier: MIT */
/**
 * Adaptation of Fc: half the difference of the mean motor torque of both directions.
 *
 * Subtracting inertia times acceleration from each sample would amplify the steps of the encoder. Its sum over a bin
 * is inertia times the sum of the changes of speed, so it is subtracted once from the sum of the bin.
 */
#include "../arith/scale.h"
#include "../model/check_params.h"
#include "dahl_compensator.h"
#include "real.h"

#define SLIDING_Q30 1041529569 /* 0.97 */
#define ONE_Q20 (INT32_C(1) << 20)
#define SPEED_LOW_Q20 31457 /* 0.03 rad/s */
#define SPEED_HIGH_Q20 ONE_Q20
#define SPEED_MAX_Q20 (INT32_C(1) << 29)
#define SLIDING_MEAN_S 0.064f /* 2^shift ticks of 32 to 64 ms: a corner at 2.5 to 5 Hz */
#define SETTLE_S 0.06f
#define BIN_S 1.0f /* 2^bin_shift samples last 0.5 to 1 s */
#define WINDOW_S 30.0f
#define ACCELERATION_PART 0.1f /* of Fc */
#define PERIOD_MAX_S 0.02f
#define BIN_SHIFT_MAX 15 /* 2^15 samples of 4 Fc in Q13 stay below 2^31 */
#define SLIDING_SHIFT_MAX 12
#define INERTIA_MAX_Q16 (UINT32_C(1) << 22)
#define GAP_MAX_Q20 (UINT32_C(1) << 30)
#define MOTOR_MAX_Q24 (INT32_C(1) << 26) /* 4 Fc */
#define CHANGE_MAX_Q16 (INT32_C(1) << 15) /* 0.5 */
#define HALF_MAX ((INT32_C(1) << 30) - 1) /* half of 2 Fc in Q30 */
#define ONE_Q13 (INT32_C(1) << 13)

/** Return 0 if all values are in range. */
static DAHL_COLD dahl_compensator_err_t check_adaptation(const dahl_compensator_params_t *params, float inertia)
{
    const dahl_params_t values = {inertia, params->period, 0.0f}; /* the ranges are those of sigma0 and Fc */
    int32_t err = dahl_check_params_by_counts(&params->friction) | dahl_check_params(&values);
    if (params->law != DAHL_COMPENSATOR_REFERENCE) {
        return DAHL_COMPENSATOR_WRONG_LAW;
    }
    if (err == DAHL_OK && dahl_bits_of(params->period) > dahl_bits_of(PERIOD_MAX_S)) {
        err = DAHL_ERR_RANGE;
    }
    return dahl_compensator_code_of(err);
}

static uint32_t ticks_of(float time, dahl_real_t period)
{
    return dahl_real_to_fixed(dahl_real_divide(dahl_real_of_param(time), period), 0, UINT32_MAX);
}

/** Return 2^shift periods. */
static dahl_real_t time_of(dahl_real_t period, uint8_t shift)
{
    dahl_real_t time = {period.mantissa, period.exponent + shift};
    return time;
}

static DAHL_COLD void write_adaptation_plan(dahl_adaptation_plan_t *plan, const dahl_compensator_params_t *params,
                                            float inertia)
{
    const dahl_real_t one = {DAHL_TOP_BIT, -31}, period = dahl_real_of_param(params->period);
    const dahl_real_t per_Fc = dahl_real_divide(dahl_real_of_param(inertia), dahl_real_of_param(params->friction.Fc));
    plan->speed_unit = dahl_real_speed_unit(one, period, dahl_real_of_param(params->friction.theta_per_count));
    plan->speed_counts = dahl_real_speed_counts(plan->speed_unit);
    plan->settle_ticks = ticks_of(SETTLE_S, period);
    plan->window_ticks = ticks_of(WINDOW_S, period);
    plan->speed_shift = dahl_real_doublings(SLIDING_MEAN_S, period, SLIDING_SHIFT_MAX);
    plan->bin_shift = dahl_real_doublings(BIN_S, period, BIN_SHIFT_MAX);
    plan->inertia_q16 =
        dahl_real_to_fixed(dahl_real_divide(per_Fc, time_of(period, plan->bin_shift)), 16, INERTIA_MAX_Q16);
    dahl_real_t gap = dahl_real_multiply(dahl_real_of_param(ACCELERATION_PART), time_of(period, plan->speed_shift));
    plan->gap_q20 = (int32_t)dahl_real_to_fixed(dahl_real_divide(gap, per_Fc), 20, GAP_MAX_Q20);
}

DAHL_COLD dahl_compensator_err_t dahl_adaptation_prepare(dahl_adaptation_plan_t *plan, const dahl_compensator_params_t *params,
                                                         float inertia)
{
    dahl_compensator_err_t err = check_adaptation(params, inertia);
    if (err == DAHL_COMPENSATOR_OK) {
        write_adaptation_plan(plan, params, inertia);
    }
    return err;
}

/** Update both means of the speed and return the change of the first. */
static int32_t update_both_speeds(const dahl_adaptation_plan_t *plan, dahl_adaptation_t *adaptation, int32_t move)
{
    int32_t counts = dahl_limit(move, (int32_t)plan->speed_counts);
    int32_t before = dahl_limit(adaptation->speed_q20, SPEED_MAX_Q20), slow = dahl_limit(adaptation->slow_q20, SPEED_MAX_Q20);
    int32_t change = (counts * (int32_t)plan->speed_unit - before) >> plan->speed_shift;
    adaptation->speed_q20 = before + change;
    adaptation->slow_q20 = slow + ((before - slow) >> plan->speed_shift);
    return change;
}

static int is_sliding(const dahl_adaptation_plan_t *plan, const dahl_adaptation_t *adaptation, int32_t motor_q24)
{
    const int32_t sign = adaptation->ratio_q30 < 0 ? -1 : 1;
    const int32_t speed = sign * adaptation->speed_q20;
    return dahl_magnitude(adaptation->ratio_q30) > SLIDING_Q30 && SPEED_LOW_Q20 <= speed && speed <= SPEED_HIGH_Q20
        && dahl_magnitude(adaptation->speed_q20 - adaptation->slow_q20) <= (uint32_t)plan->gap_q20
        && dahl_magnitude(motor_q24) <= (uint32_t)MOTOR_MAX_Q24;
}

static void empty_bins(dahl_adaptation_t *adaptation)
{
    for (int bin = 0; bin < 2; bin++) {
        adaptation->samples[bin] = 0;
        adaptation->torque_q13[bin] = 0;
        adaptation->change_q20[bin] = 0;
    }
    adaptation->age_ticks = 0;
}

/** Return the mean torque of a full bin without that of its acceleration. */
static int32_t mean_q13(const dahl_adaptation_plan_t *plan, const dahl_adaptation_t *adaptation, int bin)
{
    int32_t change_q13 = dahl_limit(adaptation->change_q20[bin] >> 7, ONE_Q13);
    int32_t inertia_q13 = (int32_t)(dahl_mul_signed(change_q13, (int32_t)plan->inertia_q16) >> 16);
    return (adaptation->torque_q13[bin] >> plan->bin_shift) - inertia_q13;
}

/** Move the estimate by a quarter of its gap. */
static void adapt(const dahl_adaptation_plan_t *plan, dahl_adaptation_t *adaptation)
{
    int32_t twice_Fc_q13 = mean_q13(plan, adaptation, 0) - mean_q13(plan, adaptation, 1);
    int32_t estimate_q16 = dahl_limit((twice_Fc_q13 - 2 * ONE_Q13) * 4, CHANGE_MAX_Q16);
    int32_t change_q16 = dahl_limit(adaptation->Fc_change_q16, CHANGE_MAX_Q16);
    adaptation->Fc_change_q16 = change_q16 + (estimate_q16 - change_q16) / 4;
}

static void add_sample(const dahl_adaptation_plan_t *plan, dahl_adaptation_t *adaptation, int bin, int32_t motor_q24,
                       int32_t change_q20)
{
    if (adaptation->samples[bin] >> plan->bin_shift == 0) {
        adaptation->samples[bin]++;
        adaptation->torque_q13[bin] = (int32_t)((uint32_t)adaptation->torque_q13[bin] + (uint32_t)(motor_q24 >> 11));
        adaptation->change_q20[bin] = (int32_t)((uint32_t)adaptation->change_q20[bin] + (uint32_t)change_q20);
    }
}

void dahl_adaptation_step(const dahl_adaptation_plan_t *plan, dahl_adaptation_t *adaptation,
                          const dahl_compensator_t *compensator, int32_t motor_q24)
{
    int32_t change_q20 = update_both_speeds(plan, adaptation, compensator->move);
    if (adaptation->age_ticks++ >= plan->window_ticks) { /* always, with a plan of zeros */
        empty_bins(adaptation);
    }
    if (!is_sliding(plan, adaptation, motor_q24) || compensator->bad_ticks != 0) {
        adaptation->sliding_ticks = 0;
        return;
    }
    if (adaptation->sliding_ticks < plan->settle_ticks) {
        adaptation->sliding_ticks++;
        return;
    }
    add_sample(plan, adaptation, adaptation->ratio_q30 < 0, motor_q24, change_q20);
    if ((adaptation->samples[0] & adaptation->samples[1]) >> plan->bin_shift != 0) {
        adapt(plan, adaptation);
        empty_bins(adaptation);
    }
}

int32_t dahl_adaptation_apply(dahl_adaptation_t *adaptation, int32_t ratio_q30)
{
    int32_t half = ratio_q30 / 2, change_q16 = dahl_limit(adaptation->Fc_change_q16, CHANGE_MAX_Q16);
    int32_t change = dahl_scale_q16(half, dahl_magnitude(change_q16));
    adaptation->ratio_q30 = ratio_q30;
    return 2 * dahl_limit(half + (change_q16 < 0 ? -change : change), HALF_MAX);
}

/* SPDX-License-Identifier: MIT */
/**
 * Residual observer: a low-pass of the motor torque that neither a feed-forward nor the inertia explains.
 *
 * With K = 2 pi corner, a tick of the low-pass is
 * @verbatim
 *     raw += K period (unexplained torque - raw) - K inertia (change of the speed)
 * @endverbatim
 * The sum of the last term is K inertia speed, so the noise of the encoder does not add up. A second low-pass at twice
 * the corner makes its steps smaller. Torques are in Q24 of Fc. Both low-passes are in Q56: their upper word is a torque.
 */
#include "../arith/scale.h"
#include "../model/check_params.h"
#include "dahl_compensator.h"
#include "real.h"

#define LARGEST_Q24 ((INT32_C(1) << 30) - 1) /* 64 Fc: a difference of two fits 32 bits */
#define MOMENTUM_UNIT_END ((uint32_t)LARGEST_Q24 + 1)
#define LIMIT_MAX_Q24 ((INT32_C(1) << 25) - 1) /* 2 Fc */
#define TWO_PI_MANTISSA 3373259426u /* exponent -29 */
#define FOUR_PI_MANTISSA_UP 3373259428u /* exponent -28; larger by more than 2^-31 of it: above every rounded product */

/** Return 2 pi corner period. */
static DAHL_COLD dahl_real_t angle_of_tick(const dahl_compensator_params_t *params,
                                           const dahl_residual_params_t *residual)
{
    const dahl_real_t two_pi = {TWO_PI_MANTISSA, -29};
    const dahl_real_t corner = dahl_real_of_param(residual->corner), period = dahl_real_of_param(params->period);
    return dahl_real_multiply(dahl_real_multiply(corner, period), two_pi);
}

/** Return K inertia times the speed of one count in a tick, in Q24 of Fc, rounded down. */
static DAHL_COLD uint32_t momentum_unit_q24(const dahl_compensator_params_t *params, const dahl_residual_params_t *residual)
{
    const dahl_real_t two_pi = {TWO_PI_MANTISSA, -29}, inertia = dahl_real_of_param(residual->inertia);
    const dahl_real_t gain = dahl_real_multiply(dahl_real_multiply(dahl_real_of_param(residual->corner), two_pi), inertia);
    const dahl_real_t theta = dahl_real_of_param(params->friction.theta_per_count);
    const dahl_real_t speed = dahl_real_divide(theta, dahl_real_of_param(params->period));
    const dahl_real_t torque = dahl_real_multiply(gain, speed);
    return dahl_real_to_fixed(dahl_real_divide(torque, dahl_real_of_param(params->friction.Fc)), 24, MOMENTUM_UNIT_END);
}

static DAHL_COLD dahl_compensator_err_t check_values(const dahl_compensator_params_t *params,
                                                     const dahl_residual_params_t *residual)
{
    int32_t err = dahl_check_params_by_counts(&params->friction) | dahl_check_value(params->period, 0);
    err |= dahl_check_value(residual->inertia, 0) | dahl_check_value(residual->corner, 0);
    err |= dahl_check_value(residual->limit, 0);
    err |= dahl_check_value(residual->speed_gain, 1) | dahl_check_value(residual->resonance, 1);
    err |= dahl_is_zero(residual->speed_gain) && dahl_is_zero(residual->resonance) ? DAHL_ERR_PARAM : DAHL_OK;
    return dahl_compensator_code_of(err);
}

/** The corner is at most a twentieth of the tick rate. */
static int is_in_range(const dahl_compensator_params_t *params, const dahl_residual_params_t *residual)
{
    const dahl_real_t one = {DAHL_TOP_BIT, -31}, twenty = {UINT32_C(5) << 29, -27};
    const dahl_real_t corners = dahl_real_multiply(dahl_real_of_param(residual->corner), twenty);
    return residual->delay < DAHL_RESIDUAL_TICKS && !dahl_real_is_product_above(corners, dahl_real_of_param(params->period), one)
        && momentum_unit_q24(params, residual) < MOMENTUM_UNIT_END;
}

/** 4 pi corner inertia > speed_gain. Without a speed_gain: 10 corner > resonance. */
static DAHL_COLD int is_corner_above_bound(const dahl_residual_params_t *residual)
{
    const dahl_real_t four_pi = {FOUR_PI_MANTISSA_UP, -28}, ten = {UINT32_C(5) << 29, -28};
    const dahl_real_t corner = dahl_real_of_param(residual->corner);
    if (dahl_is_zero(residual->speed_gain)) {
        return dahl_real_is_product_above(corner, ten, dahl_real_of_param(residual->resonance));
    }
    return dahl_real_is_product_above(dahl_real_multiply(corner, dahl_real_of_param(residual->inertia)), four_pi,
                                      dahl_real_of_param(residual->speed_gain));
}

/** With x = 2 pi corner period, the share of the second low-pass is 2 x/(1 + x): 1 - exp(-2 x) within 2 x^3/3. Both are
 * below 1/2, because x is at most 0.32. */
static DAHL_COLD void write_residual_plan(dahl_residual_plan_t *plan, const dahl_compensator_params_t *params,
                                          const dahl_residual_params_t *residual)
{
    const dahl_real_t one = {DAHL_TOP_BIT, -31}, step = angle_of_tick(params, residual);
    const dahl_real_t Fc = dahl_real_of_param(params->friction.Fc), limit = dahl_real_of_param(residual->limit);
    const dahl_real_t sum = dahl_real_multiply(dahl_real_add_up(one, step), one); /* to set its top bit */
    dahl_real_t share = dahl_real_divide(step, sum);
    share.exponent++;
    plan->step_q32 = (int32_t)dahl_real_to_fixed(step, 32, INT32_MAX);
    plan->share_q32 = (int32_t)dahl_real_to_fixed(share, 32, INT32_MAX);
    plan->momentum_q24 = (int32_t)momentum_unit_q24(params, residual);
    plan->limit_q24 = (int32_t)dahl_real_to_fixed(dahl_real_divide(limit, Fc), 24, LIMIT_MAX_Q24);
    plan->per_torque_mantissa = dahl_real_divide(one, Fc).mantissa;
    plan->per_torque_exponent = dahl_real_divide(one, Fc).exponent;
    plan->delay = residual->delay;
}

DAHL_COLD dahl_compensator_err_t dahl_residual_prepare(dahl_residual_plan_t *plan, const dahl_compensator_params_t *params,
                                                       const dahl_residual_params_t *residual)
{
    if (params->law != DAHL_COMPENSATOR_REFERENCE) {
        return DAHL_COMPENSATOR_WRONG_LAW;
    }
    const dahl_compensator_err_t err = check_values(params, residual);
    if (err != DAHL_COMPENSATOR_OK) {
        return err;
    }
    if (!is_in_range(params, residual)) {
        return DAHL_COMPENSATOR_RANGE;
    }
    if (is_corner_above_bound(residual)) {
        return DAHL_COMPENSATOR_CORNER;
    }
    write_residual_plan(plan, params, residual);
    return DAHL_COMPENSATOR_OK;
}

/** The upper half of the product has at least 30 bits, so a shift of less than 1 is a saturation. */
int32_t dahl_residual_q24(const dahl_residual_plan_t *plan, float torque)
{
    const uint32_t bits = dahl_bits_of(torque), magnitude = bits & DAHL_BITS_MAGNITUDE;
    if (magnitude > DAHL_BITS_INF) {
        return 0;
    }
    const dahl_real_t real = dahl_real_of(magnitude);
    const int32_t shift = -(real.exponent + plan->per_torque_exponent + 32 + 24);
    const uint32_t product = dahl_mulhi(real.mantissa, plan->per_torque_mantissa);
    uint32_t size = shift > 31 ? 0 : shift < 1 ? (uint32_t)LARGEST_Q24 : dahl_least(product >> shift, (uint32_t)LARGEST_Q24);
    return bits >> 31 != 0 ? -(int32_t)size : (int32_t)size;
}

/** Return the upper word. */
static inline int32_t torque_of(int64_t low_pass_q56)
{
    return (int32_t)(low_pass_q56 >> 32);
}

/** Close a share of the gap to the target. The difference and the sum wrap: from any bits, it comes to the target. */
static inline int64_t approach_q56(int64_t low_pass_q56, int32_t target_q24, int32_t share_q32)
{
    const int32_t gap_q24 = (int32_t)((uint32_t)target_q24 - (uint32_t)torque_of(low_pass_q56));
    return (int64_t)((uint64_t)low_pass_q56 + (uint64_t)dahl_mul_signed(gap_q24, share_q32));
}

/** Add a change, up to the largest torque. The lower word stays. */
static inline int64_t add_saturated(int64_t low_pass_q56, int64_t change_q24)
{
    const int64_t sum = torque_of(low_pass_q56) + change_q24;
    const int32_t torque_q24 = sum > LARGEST_Q24 ? LARGEST_Q24 : sum < -LARGEST_Q24 ? -LARGEST_Q24 : (int32_t)sum;
    return (int64_t)((uint64_t)(uint32_t)torque_q24 << 32 | (uint32_t)low_pass_q56);
}

/** The first move after a start or a fault sets the speed: its change is not known. */
static inline void observe(const dahl_residual_plan_t *plan, dahl_residual_t *residual, int32_t dcounts)
{
    const int32_t acted_q24 = residual->unexplained_q24[plan->delay & (DAHL_RESIDUAL_TICKS - 1)];
    const int32_t slower = residual->is_running != 0 ? (int32_t)((uint32_t)residual->dcounts - (uint32_t)dcounts) : 0;
    const int64_t raw_q56 = add_saturated(approach_q56(residual->raw_q56, acted_q24, plan->step_q32),
                                          dahl_mul_signed(slower, plan->momentum_q24));
    residual->raw_q56 = raw_q56;
    residual->filtered_q56 = approach_q56(residual->filtered_q56, torque_of(raw_q56), plan->share_q32);
    residual->dcounts = dcounts;
}

int32_t dahl_residual_torque(const dahl_residual_plan_t *plan, dahl_residual_t *residual,
                             const dahl_compensator_t *compensator, int32_t dcounts)
{
    const int is_good = compensator->bad_ticks == 0;
    if (is_good) {
        observe(plan, residual, dcounts);
    }
    residual->is_running = (uint32_t)is_good;
    const int32_t torque_q24 = dahl_limit(torque_of(residual->filtered_q56), plan->limit_q24);
    return dahl_scale_q16(torque_q24, dahl_least(compensator->fade_q30, DAHL_ONE_Q30) >> 14) * (INT32_C(1) << 6);
}

void dahl_residual_note(dahl_residual_t *residual, int32_t unexplained_q24)
{
    for (int k = DAHL_RESIDUAL_TICKS - 1; k > 0; k--) {
        residual->unexplained_q24[k] = residual->unexplained_q24[k - 1];
    }
    residual->unexplained_q24[0] = dahl_limit(unexplained_q24, LARGEST_Q24);
}

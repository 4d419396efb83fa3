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
 * The last move is stored plus 2^31, so that 0 can mean an unknown one: a longer move than 2^30 is a jump.
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

static DAHL_COLD dahl_compensator_err_t check_observer_values(const dahl_compensator_params_t *params,
                                                              const dahl_residual_params_t *residual)
{
    int32_t err = dahl_check_params_by_counts(&params->friction) | dahl_check_value(params->period, 0);
    err |= dahl_check_value(params->slew, 0) | dahl_check_value(residual->inertia, 0) | dahl_check_value(residual->corner, 0);
    err |= dahl_check_value(residual->limit, 0);
    err |= dahl_check_value(residual->speed_gain, 1) | dahl_check_value(residual->resonance, 1);
    err |= dahl_is_zero(residual->speed_gain) && dahl_is_zero(residual->resonance) ? DAHL_ERR_PARAM : DAHL_OK;
    return dahl_compensator_code_of(err);
}

/** Return the largest change in a tick, and one unit less: dahl_residual_change() may round the torque by one. */
static DAHL_COLD uint32_t slew_step_q24(const dahl_compensator_params_t *params)
{
    const dahl_real_t step = dahl_real_multiply(dahl_real_of_param(params->slew), dahl_real_of_param(params->period));
    const dahl_real_t Fc = dahl_real_of_param(params->friction.Fc);
    const uint32_t step_q24 = dahl_real_to_fixed(dahl_real_divide(step, Fc), 24, UINT32_MAX);
    return step_q24 > 0 ? step_q24 - 1 : 0;
}

/** Return 1 if the loop has an integral and the limit is above 0.64 Fc: the two would pass the breakaway in turns. */
static DAHL_OUT_OF_LINE int is_limit_above_bound(const dahl_compensator_params_t *params, const dahl_residual_params_t *residual)
{
    const dahl_real_t inverse = {(UINT32_C(25) << 27) - 1024, -31}; /* 1/0.64, and a product in float passes */
    const dahl_real_t limit = dahl_real_of_param(residual->limit);
    return !residual->no_integral && dahl_real_is_product_above(limit, inverse, dahl_real_of_param(params->friction.Fc));
}

/** With the noise, a move is wrong by up to 2 noise + 1 counts: the torque of them must not saturate. */
static int is_noise_in_range(const dahl_compensator_params_t *params, const dahl_residual_params_t *residual)
{
    return (2 * (uint64_t)params->noise + 2) * momentum_unit_q24(params, residual) < MOMENTUM_UNIT_END;
}

/** The corner is at most a twentieth of the tick rate. */
static int is_observer_in_range(const dahl_compensator_params_t *params, const dahl_residual_params_t *residual)
{
    const dahl_real_t one = {DAHL_TOP_BIT, -31}, twenty = {UINT32_C(5) << 29, -27};
    const dahl_real_t corners = dahl_real_multiply(dahl_real_of_param(residual->corner), twenty);
    return residual->delay < DAHL_RESIDUAL_TICKS
        && !dahl_real_is_product_above(corners, dahl_real_of_param(params->period), one)
        && is_noise_in_range(params, residual) && slew_step_q24(params) > 0
        && !is_limit_above_bound(params, residual);
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
    const dahl_real_t per_torque = dahl_real_divide(one, Fc);
    const dahl_real_t sum = dahl_real_multiply(dahl_real_add_up(one, step), one); /* to set its top bit */
    dahl_real_t share = dahl_real_divide(step, sum);
    share.exponent++;
    plan->step_q32 = (int32_t)dahl_real_to_fixed(step, 32, INT32_MAX);
    plan->share_q32 = (int32_t)dahl_real_to_fixed(share, 32, INT32_MAX);
    plan->momentum_q24 = (int32_t)momentum_unit_q24(params, residual);
    plan->limit_q24 = (int32_t)dahl_real_to_fixed(dahl_real_divide(limit, Fc), 24, LIMIT_MAX_Q24);
    plan->slew_q24 = slew_step_q24(params);
    plan->per_torque_mantissa = per_torque.mantissa;
    plan->torque_shift = 127 + 31 - 32 - 24 - per_torque.exponent; /* exponents of a float, of its product, and of Q24 */
    plan->Fc_mantissa = Fc.mantissa;
    plan->Fc_exponent = Fc.exponent;
    plan->delay = residual->delay;
}

DAHL_COLD dahl_compensator_err_t dahl_residual_prepare(dahl_residual_plan_t *plan, const dahl_compensator_params_t *params,
                                                       const dahl_residual_params_t *residual)
{
    if (params->law != DAHL_COMPENSATOR_REFERENCE) {
        return DAHL_COMPENSATOR_WRONG_LAW;
    }
    const dahl_compensator_err_t err = check_observer_values(params, residual);
    if (err != DAHL_COMPENSATOR_OK) {
        return err;
    }
    if (!is_observer_in_range(params, residual)) {
        return DAHL_COMPENSATOR_RANGE;
    }
    if (is_corner_above_bound(residual)) {
        return DAHL_COMPENSATOR_CORNER;
    }
    write_residual_plan(plan, params, residual);
    return DAHL_COMPENSATOR_OK;
}

/** The exponent field of the float and torque_shift give the shift of the product. */
int32_t dahl_residual_q24(const dahl_residual_plan_t *plan, float torque)
{
    const uint32_t bits = dahl_bits_of(torque), exponent = bits >> 23 & 0xff;
    const uint32_t shift = (uint32_t)plan->torque_shift - exponent;
    uint32_t size = dahl_mulhi(DAHL_TOP_BIT | bits << 8, plan->per_torque_mantissa) >> (shift & 31);
    if (shift - 1 >= 31) {
        const int is_large = (int32_t)shift < 1 && (bits & DAHL_BITS_MAGNITUDE) <= DAHL_BITS_INF;
        size = is_large ? INT32_MAX : 0;
    }
    return bits >> 31 != 0 ? -(int32_t)size : (int32_t)size;
}

/** Return the upper word. */
static inline int32_t upper_word(int64_t low_pass_q56)
{
    return (int32_t)(low_pass_q56 >> 32);
}

/** Close a share of the gap to the target. The difference and the sum wrap: from any bits, it comes to the target. */
static inline int64_t approach_q56(int64_t low_pass_q56, int32_t target_q24, int32_t share_q32)
{
    const int32_t gap_q24 = (int32_t)((uint32_t)target_q24 - (uint32_t)upper_word(low_pass_q56));
    return (int64_t)((uint64_t)low_pass_q56 + (uint64_t)dahl_mul_signed(gap_q24, share_q32));
}

/** Add a change. Outside -2^30 .. 2^30 - 1, the sum becomes the largest torque. The lower word stays. */
static inline int64_t add_saturated(int64_t low_pass_q56, int64_t change_q24)
{
    const int64_t sum = upper_word(low_pass_q56) + change_q24;
    int32_t torque_q24 = (int32_t)sum;
    if ((uint64_t)(sum + DAHL_ONE_Q30) >> 31 != 0) {
        torque_q24 = sum < 0 ? -LARGEST_Q24 : LARGEST_Q24;
    }
    return (int64_t)((uint64_t)(uint32_t)torque_q24 << 32 | (uint32_t)low_pass_q56);
}

/** Update both low-passes. The first move after a start or a long fault only sets the speed, because its change is unknown. After
 * a short fault, the change since the last move counts: otherwise each fault would leave the noise of that move in the sum. */
static inline void observe(const dahl_residual_plan_t *plan, dahl_residual_t *residual, int32_t dcounts)
{
    const uint32_t before = residual->move, move = (uint32_t)dcounts ^ DAHL_TOP_BIT;
    int64_t raw_q56 = approach_q56(residual->raw_q56, residual->unexplained_q24[plan->delay], plan->step_q32);
    if (before != 0) {
        raw_q56 = add_saturated(raw_q56, dahl_mul_signed((int32_t)(before - move), plan->momentum_q24));
    }
    residual->move = move;
    residual->raw_q56 = raw_q56;
    residual->filtered_q56 = approach_q56(residual->filtered_q56, upper_word(raw_q56), plan->share_q32);
}

/** Fade, then slew, then limit. The limit comes last, so that it also holds if the state is corrupt. */
int32_t dahl_residual_torque(const dahl_residual_plan_t *plan, dahl_residual_t *residual,
                             const dahl_compensator_t *compensator, int32_t dcounts)
{
    if (compensator->bad_ticks == 0) {
        observe(plan, residual, dcounts);
    } else if (compensator->bad_ticks >= DAHL_COMPENSATOR_BAD_TICKS) {
        residual->move = 0;
    }
    const uint32_t fade_q16 = dahl_least(compensator->fade_q30 >> 14, UINT32_C(1) << 16);
    const int32_t wanted_q24 = dahl_scale_q16(upper_word(residual->filtered_q56), fade_q16);
    const int32_t torque_q24 = dahl_limit(dahl_approach(residual->torque_q24, wanted_q24, plan->slew_q24), plan->limit_q24);
    residual->torque_q24 = torque_q24;
    return torque_q24 * (INT32_C(1) << 6);
}

void dahl_residual_note(dahl_residual_t *residual, int32_t unexplained_q24)
{
    for (int k = DAHL_RESIDUAL_TICKS - 1; k > 0; k--) {
        residual->unexplained_q24[k] = residual->unexplained_q24[k - 1];
    }
    if (((uint32_t)unexplained_q24 + DAHL_ONE_Q30) >> 31 != 0) {
        unexplained_q24 = unexplained_q24 < 0 ? -LARGEST_Q24 : LARGEST_Q24;
    }
    residual->unexplained_q24[0] = unexplained_q24;
}

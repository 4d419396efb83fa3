/* SPDX-License-Identifier: MIT */
/**
 * Bristle whose limit changes with speed, as LuGre's. All torques are in parts of the larger of Fs and Fc:
 * @verbatim
 *     h = 1 - exp(-x^2)              x = |speed| over the Stribeck speed; the kernel returns h
 *     f = Fs + (Fc - Fs) h           limit at this speed
 *     z = f - s w                    gap in the direction s, in Q30; below 0 if F is above the limit
 *     w += s z (1 - exp(-u/f))       u: travel in presliding lengths of the larger limit
 * @endverbatim
 * This is the exact solution of dF/dtheta = sigma0 (1 - s F/f) for the constant f of the tick.
 *
 * @par Passivity
 * sigma0 is constant, so the stored energy is w^2/2 for any f, and a change of f alone changes no energy. A move
 * dissipates the integral of w^2/f du >= 0 for any f > 0. A w above the limit returns to it by travel.
 *
 * @par Range
 * f is at most 1, so w stays in the range of ../model/bristle_update.h: from below a gap of at most half a unit too
 * much, from above towards f.
 */
#include "../model/bristle_update.h"
#include "../model/check_params.h"
#include "../model/kernel.h"
#include "../model/prepare_table.h"
#include "../model/torque.h"
#include "dahl_parts.h"
#include "model.h"
#include "reciprocal.h"

#define SQRT_LOG2_E_Q31 2579390733u         /* x^2 log2(e) is the argument of the kernel */
#define NO_SPEED_EXPONENT (-200)            /* of the speed of a count: h is 0 for any counts */
#define LIMIT_RATIO_MIN (DAHL_ONE_Q62 >> 4) /* [Q62] smaller limit over the larger one */
#define COUNT_SHARE_MAX (DAHL_ONE_Q62 >> 2) /* [Q62] of a count in speed_travel */

/** Return |n| 2^exponent times the factor, for any n. If n is 0, return that of 1. */
static inline dahl_scaled_t scaled_product(int32_t n, uint32_t factor, int32_t exponent)
{
    uint32_t size = n < 0 ? 0u - (uint32_t)n : (uint32_t)n;
    uint32_t zeros = dahl_leading_zeros(size | 1);
    return dahl_scaled_of(dahl_mul((size | (size == 0)) << zeros, factor), exponent - (int32_t)zeros);
}

/** Return f in Q32 at the speed x sqrt(log2 e). */
static inline uint32_t limit_at(const dahl_stribeck_plan_t *plan, dahl_scaled_t x)
{
    const uint32_t slow = plan->slow_q32, fast = plan->fast_q32;
    dahl_scaled_t h = dahl_kernel(dahl_scaled_of(dahl_mul(x.mantissa, x.mantissa), -64 - 2 * x.shift));
    uint32_t whole = slow < fast ? fast - slow : slow - fast;
    uint32_t change = h.shift < 32 ? dahl_mulhi(whole, h.mantissa) >> h.shift : 0;
    return slow < fast ? slow + change : slow - change;
}

/** Return g = 1 - exp(-u/f) for a move by counts, not 0. */
static inline dahl_scaled_t fraction_of_gap(const dahl_stribeck_plan_t *plan, int32_t dcounts, uint32_t limit_q32)
{
    dahl_scaled_t u = scaled_product(dcounts, plan->a_mantissa, plan->a_exponent);
    uint32_t zeros = dahl_leading_zeros(limit_q32), inverse = dahl_reciprocal_q31(limit_q32 << zeros);
    return dahl_kernel(dahl_scaled_of(dahl_mul(u.mantissa, inverse), (int32_t)zeros - u.shift - 63));
}

static DAHL_OUT_OF_LINE uint64_t move_at_limit(const dahl_stribeck_plan_t *plan, uint64_t w, int32_t dcounts, dahl_scaled_t x)
{
    uint64_t in_direction = dcounts < 0 ? 0u - dahl_clamp(w) : dahl_clamp(w);
    if (dcounts == 0 || plan->a_mantissa == 0) { /* no move, or a plan of all zeros */
        return dahl_clamp(w);
    }
    uint32_t limit_q32 = limit_at(plan, x), q30 = dahl_q30(in_direction);
    uint32_t limit = (limit_q32 >> 2) + (limit_q32 >> 1 & 1);
    dahl_scaled_t g = fraction_of_gap(plan, dcounts, limit_q32);
    if ((int32_t)q30 > (int32_t)limit) {
        in_direction -= dahl_mul_scaled(q30 - limit, g);
    } else {
        in_direction += dahl_mul_scaled(limit - q30, g);
    }
    return dcounts < 0 ? 0u - in_direction : in_direction;
}

static inline uint64_t move_by_counts(const dahl_stribeck_plan_t *plan, uint64_t w, int32_t dcounts)
{
    return move_at_limit(plan, w, dcounts, scaled_product(dcounts, plan->speed_mantissa, plan->speed_exponent));
}

static inline uint64_t move_at_speed(const dahl_stribeck_plan_t *plan, uint64_t w, int32_t dcounts, int32_t speed_q20)
{
    return move_at_limit(plan, w, dcounts, scaled_product(speed_q20, SQRT_LOG2_E_Q31, -31 - 20));
}

static inline float keep_and_convert(const dahl_stribeck_plan_t *plan, dahl_state_t *state, uint64_t w)
{
    const dahl_real_t larger = {plan->limit_mantissa | 1, plan->limit_exponent};
    state->w = (int64_t)w;
    return plan->limit_mantissa == 0 ? 0.0f : dahl_torque_from(larger, w);
}

static inline int32_t keep_and_round(dahl_state_t *state, uint64_t w)
{
    state->w = (int64_t)w;
    return (int32_t)dahl_q30(w);
}

float dahl_stribeck_step_counts(const dahl_stribeck_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    return keep_and_convert(plan, state, move_by_counts(plan, (uint64_t)state->w, dcounts));
}

int32_t dahl_stribeck_step_counts_q30(const dahl_stribeck_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    return keep_and_round(state, move_by_counts(plan, (uint64_t)state->w, dcounts));
}

float dahl_stribeck_step_at_speed(const dahl_stribeck_plan_t *plan, dahl_state_t *state, int32_t dcounts, int32_t speed_q20)
{
    return keep_and_convert(plan, state, move_at_speed(plan, (uint64_t)state->w, dcounts, speed_q20));
}

int32_t dahl_stribeck_step_at_speed_q30(const dahl_stribeck_plan_t *plan, dahl_state_t *state, int32_t dcounts,
                                        int32_t speed_q20)
{
    return keep_and_round(state, move_at_speed(plan, (uint64_t)state->w, dcounts, speed_q20));
}

/** Return a ratio in Q32; 1 as the largest number of 32 bits. */
static inline uint32_t q32_of(uint64_t ratio_q62)
{
    return ratio_q62 == DAHL_ONE_Q62 ? UINT32_MAX : (uint32_t)(ratio_q62 >> 30);
}

static DAHL_COLD void write_travel_scale(dahl_stribeck_plan_t *plan, const dahl_stribeck_params_t *params, dahl_real_t larger)
{
    const dahl_real_t log2_e = {DAHL_LOG2_E_Q31, -31};
    const dahl_real_t sigma0 = dahl_real_of_float(params->sigma0), theta = dahl_real_of_float(params->theta_per_count);
    const uint64_t a = dahl_quotient_q63(sigma0.mantissa, larger.mantissa);
    const dahl_wide_t travel = dahl_product(a, sigma0.exponent - larger.exponent - 63, theta);
    const dahl_wide_t per_ln2 = dahl_product(travel.mantissa, travel.exponent, log2_e);
    plan->a_mantissa = (uint32_t)(per_ln2.mantissa >> 32);
    plan->a_exponent = per_ln2.exponent + 32;
}

static DAHL_COLD void write_speed_scale(dahl_stribeck_plan_t *plan, const dahl_stribeck_params_t *params)
{
    const dahl_real_t theta = dahl_real_of_float(params->theta_per_count), tick = dahl_real_of_float(params->speed_travel);
    const dahl_real_t root = {SQRT_LOG2_E_Q31, -31};
    if (dahl_bits_of(params->speed_travel) == 0) {
        plan->speed_mantissa = DAHL_TOP_BIT;
        plan->speed_exponent = NO_SPEED_EXPONENT;
        return;
    }
    const uint64_t per_count = dahl_quotient_q63(theta.mantissa, tick.mantissa);
    const dahl_wide_t speed = dahl_product(per_count, theta.exponent - tick.exponent - 63, root);
    plan->speed_mantissa = (uint32_t)(speed.mantissa >> 32);
    plan->speed_exponent = speed.exponent + 32;
}

static DAHL_COLD int32_t check_both_limits(const dahl_stribeck_params_t *params)
{
    const dahl_real_t slow = dahl_real_of_float(params->Fs), fast = dahl_real_of_float(params->Fc);
    const uint64_t slow_ratio = dahl_ratio_q62(slow, fast), fast_ratio = dahl_ratio_q62(fast, slow);
    return slow_ratio < LIMIT_RATIO_MIN || fast_ratio < LIMIT_RATIO_MIN ? DAHL_ERR_RANGE : DAHL_OK;
}

/** Check the travel of a tick at the Stribeck speed; 0 is valid. */
static DAHL_COLD int32_t check_speed(const dahl_stribeck_params_t *params)
{
    const uint32_t bits = dahl_bits_of(params->speed_travel);
    if (bits == 0) {
        return DAHL_OK;
    }
    if (bits >= DAHL_BITS_INF) { /* infinite, NaN, or negative */
        return DAHL_ERR_PARAM;
    }
    if (bits < dahl_bits_of(DAHL_TORQUE_MIN) || bits >= dahl_bits_of(DAHL_TORQUE_MAX)) {
        return DAHL_ERR_RANGE;
    }
    const uint64_t inverse = dahl_ratio_q62(dahl_real_of_float(params->theta_per_count), dahl_real_of(bits));
    return inverse > COUNT_SHARE_MAX ? DAHL_ERR_RANGE : DAHL_OK;
}

static DAHL_COLD void write_stribeck(dahl_stribeck_plan_t *plan, const dahl_stribeck_params_t *params)
{
    const dahl_real_t slow = dahl_real_of_float(params->Fs), fast = dahl_real_of_float(params->Fc);
    const uint64_t slow_ratio = dahl_ratio_q62(slow, fast);
    const dahl_real_t larger = slow_ratio == DAHL_ONE_Q62 ? slow : fast;
    plan->slow_q32 = q32_of(slow_ratio);
    plan->fast_q32 = q32_of(dahl_ratio_q62(fast, slow));
    plan->limit_mantissa = larger.mantissa;
    plan->limit_exponent = larger.exponent;
    write_travel_scale(plan, params, larger);
    write_speed_scale(plan, params);
}

DAHL_COLD dahl_err_t dahl_stribeck_prepare(dahl_stribeck_plan_t *plan, const dahl_stribeck_params_t *params)
{
    const dahl_params_t slow = {params->sigma0, params->Fs, params->theta_per_count};
    const dahl_params_t fast = {params->sigma0, params->Fc, params->theta_per_count};
    int32_t err = dahl_check_params_by_counts(&slow) | dahl_check_params_by_counts(&fast);
    if (err == DAHL_OK) {
        err = check_both_limits(params) | check_speed(params);
    }
    if (err == DAHL_OK) {
        write_stribeck(plan, params);
    }
    return (dahl_err_t)err;
}

static DAHL_COLD dahl_err_t prepare_stribeck(void *plan, const dahl_model_params_t *params)
{
    dahl_stribeck_params_t one;
    one.sigma0 = params->each.sigma0[0];
    one.Fs = params->each.Fc[0];
    one.Fc = params->each.Fc[1];
    one.theta_per_count = params->each.theta_per_count;
    one.speed_travel = params->own;
    return dahl_stribeck_prepare((dahl_stribeck_plan_t *)plan, &one);
}
DAHL_DEFINE_MODEL_BY_COUNTS(stribeck)

/* SPDX-License-Identifier: MIT */
/** Dahl and slip elements on one shaft as a model chosen at run time. The ratio is the sum of w_k = F_k/Fc_k times its
 * share Fc_k / sum of Fc. Shares are integer multiples of 2^-62 with the sum 1: if all elements are at Fc, the ratio is
 * exactly 1. Error: 2^-32 from rounding w to Q31, 2^-31 from rounding the sum, plus the errors of the elements
 * times their shares. */
#include "../arith/fixed.h"
#include "../arith/multiply.h"
#include "../model/check_params.h"
#include "model.h"
#include "shift.h"

#define ONE_Q62 (UINT64_C(1) << 62)

/** Round x >> bits to the nearest integer, a half away from 0, so that both directions are alike. */
static int64_t round_shift(int64_t x, uint32_t bits)
{
    uint64_t size = (x < 0 ? 0u - (uint64_t)x : (uint64_t)x) + (UINT64_C(1) << (bits - 1));
    return x < 0 ? -(int64_t)(size >> bits) : (int64_t)(size >> bits);
}

/** Return w (Q62) times a share (Q62). */
static int64_t times_share(int64_t w, uint64_t share)
{
    const int64_t w_q31 = round_shift(w, 31);
    const uint32_t size = (uint32_t)(w_q31 < 0 ? -w_q31 : w_q31), high = (uint32_t)(share >> 31);
    const int64_t product = (int64_t)(dahl_mul(size, high) + (dahl_mul(size, (uint32_t)share & 0x7fffffffu) >> 31));
    return w_q31 < 0 ? -product : product;
}

static int32_t step_parallel_q30(const void *plan, void *state, int32_t dcounts, uint32_t load_q30)
{
    const dahl_parallel_plan_t *mix = (const dahl_parallel_plan_t *)plan;
    dahl_parallel_state_t *moved = (dahl_parallel_state_t *)state;
    int64_t sum = 0;
    (void)load_q30;
    if (mix->slip.elements != 0) {
        sum = times_share(dahl_slip_part_move(&mix->slip, &moved->slip, dcounts), mix->slip_share);
    }
    for (uint32_t k = 0; k < mix->bearings; k++) {
        (void)dahl_step_counts_q30(&mix->plan[k], &moved->state[k], dcounts);
        sum += times_share(moved->state[k].w, mix->share[k]);
    }
    return (int32_t)round_shift(sum, 32);
}

static float step_parallel(const void *plan, void *state, int32_t dcounts, uint32_t load_q30)
{
    const dahl_parallel_plan_t *mix = (const dahl_parallel_plan_t *)plan;
    dahl_parallel_state_t *moved = (dahl_parallel_state_t *)state;
    const dahl_part_t slip = DAHL_SLIP_PART(&mix->slip, &moved->slip);
    dahl_part_t parts[DAHL_SLIP_MAX + 1];
    uint32_t count = 0;
    (void)load_q30;
    if (mix->slip.elements != 0) {
        parts[count++] = slip;
    }
    for (uint32_t k = 0; k < mix->bearings; k++) {
        const dahl_part_t bearing = DAHL_PART(&mix->plan[k], &moved->state[k]);
        parts[count++] = bearing;
    }
    return dahl_parallel_step_counts(parts, count, dcounts);
}

/** Return Fc = mantissa 2^exponent in units of 2^(highest - 27). Nine values stay below 2^63. */
static uint64_t align_Fc(uint32_t mantissa, int32_t exponent, int32_t highest)
{
    return dahl_shift_right((uint64_t)mantissa << 27, (uint32_t)(highest - exponent));
}

static int32_t highest_exponent(const dahl_parallel_plan_t *mix)
{
    int32_t highest = mix->slip.elements != 0 ? mix->slip.Fc_exponent : mix->plan[0].Fc_exponent;
    for (uint32_t k = 0; k < mix->bearings; k++) {
        highest = mix->plan[k].Fc_exponent > highest ? mix->plan[k].Fc_exponent : highest;
    }
    return highest;
}

/** The slip elements, or else the first Dahl element, get the remainder of the rounding. */
static void distribute_shares(dahl_parallel_plan_t *mix)
{
    const int32_t highest = highest_exponent(mix);
    uint64_t sum = mix->slip.elements == 0 ? 0 : align_Fc(mix->slip.Fc_mantissa, mix->slip.Fc_exponent, highest);
    uint64_t remainder = ONE_Q62;
    mix->slip_share = 0;
    for (uint32_t k = 0; k < mix->bearings; k++) {
        sum += align_Fc(mix->plan[k].Fc_mantissa, mix->plan[k].Fc_exponent, highest);
    }
    for (uint32_t k = 0; k < mix->bearings; k++) {
        mix->share[k] = dahl_quotient(align_Fc(mix->plan[k].Fc_mantissa, mix->plan[k].Fc_exponent, highest), sum, 62);
        remainder -= mix->share[k];
    }
    *(mix->slip.elements != 0 ? &mix->slip_share : &mix->share[0]) += remainder;
}

static int is_slip(const dahl_model_params_t *params, uint32_t k)
{
    return (params->slips >> k & 1u) != 0;
}

static int32_t check_elements(const dahl_model_params_t *params)
{
    int32_t err = DAHL_OK;
    for (uint32_t k = 0; k < params->each.elements; k++) {
        const dahl_params_t one = dahl_element_params(params, k);
        err |= dahl_check_params(&one);
    }
    return err;
}

static int32_t check_mix(const dahl_model_params_t *params)
{
    const uint32_t elements = params->each.elements;
    if (elements == 0 || elements > DAHL_SLIP_MAX) {
        return elements == 0 ? DAHL_ERR_PARAM : DAHL_ERR_RANGE;
    }
    const int is_positive = (int32_t)dahl_bits_of(params->each.theta_per_count) > 0; /* a NaN is found below */
    return is_positive ? check_elements(params) : DAHL_ERR_PARAM;
}

/** Write the plans in place, because a copy needs 2.7 KiB of stack. check_mix() has accepted each element, so DAHL_OK
 * is returned. The slip parameters have no initializer, because compilers replace it by memset, which a bare link does
 * not have. */
static int32_t prepare_elements(dahl_parallel_plan_t *mix, const dahl_model_params_t *params)
{
    dahl_slip_params_t slip;
    int32_t err = DAHL_OK;
    slip.theta_per_count = params->each.theta_per_count;
    slip.elements = 0;
    mix->bearings = 0;
    for (uint32_t k = 0; k < params->each.elements; k++) {
        const dahl_params_t one = dahl_element_params(params, k);
        if (is_slip(params, k)) {
            slip.sigma0[slip.elements] = one.sigma0;
            slip.Fc[slip.elements] = one.Fc;
            slip.elements++;
        } else {
            err |= dahl_prepare(&mix->plan[mix->bearings], &one);
            mix->bearings++;
        }
    }
    mix->slip.elements = 0;
    return slip.elements == 0 ? err : err | dahl_slip_prepare(&mix->slip, &slip);
}

static dahl_err_t prepare_parallel(void *plan, const dahl_model_params_t *params)
{
    dahl_parallel_plan_t *mix = (dahl_parallel_plan_t *)plan;
    int32_t err = check_mix(params);
    if (err == DAHL_OK) {
        err = prepare_elements(mix, params);
        distribute_shares(mix);
    }
    return (dahl_err_t)err;
}

DAHL_DEFINE_MODEL(parallel, dahl_parallel_plan_t, dahl_parallel_state_t)

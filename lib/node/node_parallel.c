/* SPDX-License-Identifier: MIT */
/*
 * A node that answers by Dahl and slip elements on one shaft; a firmware that does not call this links none of it. The ratio on
 * the bus is the sum of w_k = F_k/Fc_k, each by its share Fc_k over the sum of Fc. Shares are whole numbers of 2^-62 whose sum is
 * 1, so that all elements at their Fc answer exactly 1.
 * Error of the ratio: 2^-32 where w is rounded to Q31, 2^-31 where the sum is rounded, and those of the elements' own moves, by
 * their shares.
 */
#include "use_model.h"

#define ONE_Q31 (INT64_C(1) << 31)
#define ONE_Q62 (UINT64_C(1) << 62)

static dahl_node_parallel_t *parallel_of(dahl_node_model_t *model)
{
    return (dahl_node_parallel_t *)(void *)model;
}

/* To the nearest whole number, a half away from 0, so that both directions are alike. */
static int64_t rounded_quotient(int64_t x, int64_t power_of_two)
{
    return (x + (x < 0 ? -power_of_two : power_of_two) / 2) / power_of_two;
}

/* w in Q62 by a share in Q62. */
static int64_t by_share(int64_t w, uint64_t share)
{
    int64_t w_q31 = rounded_quotient(w, ONE_Q31), high = (int64_t)(share >> 31), low = (int64_t)(share & 0x7fffffffu);
    return w_q31 * high + w_q31 * low / ONE_Q31;
}

static int32_t step_q30(dahl_node_model_t *model, int32_t dcounts)
{
    dahl_node_parallel_t *kept = parallel_of(model);
    int64_t sum = 0;
    if (kept->slip.elements != 0) {
        sum = by_share(dahl_slip_part_move(&kept->slip, &kept->slip_state, dcounts), kept->slip_share);
    }
    for (uint32_t k = 0; k < kept->bearings; k++) {
        (void)dahl_step_counts_q30(&kept->plan[k], &kept->state[k], dcounts);
        sum += by_share(kept->state[k].w, kept->share[k]);
    }
    return (int32_t)rounded_quotient(sum, 2 * ONE_Q31);
}

static void relax(dahl_node_model_t *model)
{
    dahl_node_parallel_t *kept = parallel_of(model);
    kept->slip_state = (dahl_slip_state_t){{0}};
    for (uint32_t k = 0; k < DAHL_SLIP_MAX; k++) {
        kept->state[k] = (dahl_state_t){0};
    }
}

/* Fc = mantissa 2^exponent in units of 2^(highest - 27): nine of them are below 2^63. */
static uint64_t aligned(uint32_t mantissa, int32_t exponent, int32_t highest)
{
    int32_t below = highest - exponent;
    return below > 58 ? 0 : ((uint64_t)mantissa << 27) >> below;
}

/* part/whole in Q62, rounded down, for part <= whole < 2^63: the long division, bit by bit. */
static uint64_t ratio_q62(uint64_t part, uint64_t whole)
{
    uint64_t ratio = 0;
    for (int bit = 0; bit <= 62; bit++) {
        ratio <<= 1;
        if (part >= whole) {
            part -= whole;
            ratio |= 1;
        }
        part <<= 1;
    }
    return ratio;
}

static int32_t highest_exponent(const dahl_node_parallel_t *kept)
{
    int32_t highest = kept->slip.elements != 0 ? kept->slip.Fc_exponent : kept->plan[0].Fc_exponent;
    for (uint32_t k = 0; k < kept->bearings; k++) {
        highest = kept->plan[k].Fc_exponent > highest ? kept->plan[k].Fc_exponent : highest;
    }
    return highest;
}

/* Shares of the sum; what rounding leaves goes to the slip elements, or to the first bearing. */
static void share_out(dahl_node_parallel_t *kept)
{
    const int32_t highest = highest_exponent(kept);
    uint64_t sum = kept->slip.elements == 0 ? 0 : aligned(kept->slip.Fc_mantissa, kept->slip.Fc_exponent, highest);
    uint64_t left = ONE_Q62;
    for (uint32_t k = 0; k < kept->bearings; k++) {
        sum += aligned(kept->plan[k].Fc_mantissa, kept->plan[k].Fc_exponent, highest);
    }
    for (uint32_t k = 0; k < kept->bearings; k++) {
        kept->share[k] = ratio_q62(aligned(kept->plan[k].Fc_mantissa, kept->plan[k].Fc_exponent, highest), sum);
        left -= kept->share[k];
    }
    *(kept->slip.elements != 0 ? &kept->slip_share : &kept->share[0]) += left;
}

static int is_slip(const dahl_node_parallel_params_t *params, uint32_t k)
{
    return (params->slips >> k & 1u) != 0;
}

static dahl_err_t prepare_bearings(dahl_node_parallel_t *kept, const dahl_node_parallel_params_t *params)
{
    dahl_err_t err = DAHL_OK;
    for (uint32_t k = 0; k < params->elements && err == DAHL_OK; k++) {
        if (!is_slip(params, k)) {
            const dahl_params_t one = {params->sigma0[k], params->Fc[k], params->theta_per_count};
            err = dahl_prepare(&kept->plan[kept->bearings], &one);
            kept->bearings++;
        }
    }
    return err;
}

static dahl_err_t prepare_slip(dahl_node_parallel_t *kept, const dahl_node_parallel_params_t *params)
{
    dahl_slip_params_t slip = {.theta_per_count = params->theta_per_count};
    for (uint32_t k = 0; k < params->elements; k++) {
        if (is_slip(params, k)) {
            slip.sigma0[slip.elements] = params->sigma0[k];
            slip.Fc[slip.elements] = params->Fc[k];
            slip.elements++;
        }
    }
    return slip.elements == 0 ? DAHL_OK : dahl_slip_prepare(&kept->slip, &slip);
}

static dahl_err_t check(const dahl_node_parallel_params_t *params)
{
    if (params->elements == 0 || params->elements > DAHL_SLIP_MAX) {
        return params->elements == 0 ? DAHL_ERR_PARAM : DAHL_ERR_RANGE;
    }
    return params->theta_per_count > 0.0f ? DAHL_OK : DAHL_ERR_PARAM;
}

dahl_err_t dahl_node_use_parallel(dahl_node_t *node, dahl_node_parallel_t *kept, const dahl_node_parallel_params_t *params)
{
    dahl_node_parallel_t made = {.model = {step_q30, relax, DAHL_FRAMES_MODEL_PARALLEL + params->elements, 0}};
    dahl_params_t sums = {.theta_per_count = params->theta_per_count};
    dahl_err_t err = check(params);
    err = err == DAHL_OK ? prepare_bearings(&made, params) : err;
    err = err == DAHL_OK ? prepare_slip(&made, params) : err;
    if (err == DAHL_OK) {
        share_out(&made);
        for (uint32_t k = 0; k < params->elements; k++) {
            sums.sigma0 += params->sigma0[k];
            sums.Fc += params->Fc[k];
        }
        *kept = made;
        dahl_node_use(node, &kept->model, &sums);
    }
    return err;
}

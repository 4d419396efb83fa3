/* SPDX-License-Identifier: MIT */
/** Node with Dahl and slip elements on one shaft. The ratio on the bus is the sum of w_k = F_k/Fc_k times its share
 * Fc_k / sum of Fc. Shares are integer multiples of 2^-62 with the sum 1: if all elements are at Fc, the answer is
 * exactly 1. Error: 2^-32 from rounding w to Q31, 2^-31 from rounding the sum, plus the errors of the elements
 * times their shares. */
#include "../model/check_params.h"
#include "use_model.h"

#define ONE_Q31 (INT64_C(1) << 31)
#define ONE_Q62 (UINT64_C(1) << 62)

static dahl_node_parallel_t *parallel_of(dahl_node_model_t *model)
{
    return (dahl_node_parallel_t *)(void *)model;
}

/** Round to the nearest integer, a half away from 0, so that both directions are alike. */
static int64_t rounded_quotient(int64_t x, int64_t power_of_two)
{
    return (x + (x < 0 ? -power_of_two : power_of_two) / 2) / power_of_two;
}

/** Return w (Q62) times a share (Q62). */
static int64_t times_share(int64_t w, uint64_t share)
{
    int64_t w_q31 = rounded_quotient(w, ONE_Q31), high = (int64_t)(share >> 31), low = (int64_t)(share & 0x7fffffffu);
    return w_q31 * high + w_q31 * low / ONE_Q31;
}

static int32_t step_parallel_q30(dahl_node_model_t *model, int32_t dcounts)
{
    dahl_node_parallel_t *storage = parallel_of(model);
    int64_t sum = 0;
    if (storage->slip.elements != 0) {
        sum = times_share(dahl_slip_part_move(&storage->slip, &storage->slip_state, dcounts), storage->slip_share);
    }
    for (uint32_t k = 0; k < storage->bearings; k++) {
        (void)dahl_step_counts_q30(&storage->plan[k], &storage->state[k], dcounts);
        sum += times_share(storage->state[k].w, storage->share[k]);
    }
    return (int32_t)rounded_quotient(sum, 2 * ONE_Q31);
}

static void relax_parallel(dahl_node_model_t *model)
{
    dahl_node_parallel_t *storage = parallel_of(model);
    storage->slip_state = (dahl_slip_state_t){{0}};
    for (uint32_t k = 0; k < DAHL_SLIP_MAX; k++) {
        storage->state[k] = (dahl_state_t){0};
    }
}

/** Return Fc = mantissa 2^exponent in units of 2^(highest - 27). Nine values stay below 2^63. */
static uint64_t align_Fc(uint32_t mantissa, int32_t exponent, int32_t highest)
{
    int32_t below = highest - exponent;
    return below > 58 ? 0 : ((uint64_t)mantissa << 27) >> below;
}

/** Return part/whole in Q62, truncated, for part <= whole < 2^63. Long division, bit by bit. */
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

static int32_t highest_exponent(const dahl_node_parallel_t *storage)
{
    int32_t highest = storage->slip.elements != 0 ? storage->slip.Fc_exponent : storage->plan[0].Fc_exponent;
    for (uint32_t k = 0; k < storage->bearings; k++) {
        highest = storage->plan[k].Fc_exponent > highest ? storage->plan[k].Fc_exponent : highest;
    }
    return highest;
}

/** The slip elements, or else the first Dahl element, get the remainder of the rounding. */
static void distribute_shares(dahl_node_parallel_t *storage)
{
    const int32_t highest = highest_exponent(storage);
    uint64_t sum = storage->slip.elements == 0 ? 0 : align_Fc(storage->slip.Fc_mantissa, storage->slip.Fc_exponent, highest);
    uint64_t remainder = ONE_Q62;
    storage->slip_share = 0;
    for (uint32_t k = 0; k < storage->bearings; k++) {
        sum += align_Fc(storage->plan[k].Fc_mantissa, storage->plan[k].Fc_exponent, highest);
    }
    for (uint32_t k = 0; k < storage->bearings; k++) {
        storage->share[k] = ratio_q62(align_Fc(storage->plan[k].Fc_mantissa, storage->plan[k].Fc_exponent, highest), sum);
        remainder -= storage->share[k];
    }
    *(storage->slip.elements != 0 ? &storage->slip_share : &storage->share[0]) += remainder;
}

static int is_slip(const dahl_node_parallel_params_t *params, uint32_t k)
{
    return (params->slips >> k & 1u) != 0;
}

static dahl_params_t element_params(const dahl_node_parallel_params_t *params, uint32_t k)
{
    return (dahl_params_t){params->sigma0[k], params->Fc[k], params->theta_per_count};
}

/** Return the error of the first wrong Dahl element, else that of the slip elements. */
static dahl_err_t check_elements(const dahl_node_parallel_params_t *params)
{
    int32_t err = DAHL_OK, slip_err = DAHL_OK;
    for (uint32_t k = 0; k < params->elements; k++) {
        const dahl_params_t one = element_params(params, k);
        const int32_t found = dahl_check_params(&one);
        slip_err |= is_slip(params, k) ? found : DAHL_OK;
        err = err == DAHL_OK && !is_slip(params, k) ? found : err;
    }
    return (dahl_err_t)(err == DAHL_OK ? slip_err : err);
}

static dahl_err_t check_mix(const dahl_node_parallel_params_t *params)
{
    if (params->elements == 0 || params->elements > DAHL_SLIP_MAX) {
        return params->elements == 0 ? DAHL_ERR_PARAM : DAHL_ERR_RANGE;
    }
    return params->theta_per_count > 0.0f ? check_elements(params) : DAHL_ERR_PARAM;
}

/** Write the plans into the storage itself, because a copy needs 2.7 KiB of stack. check_mix() has accepted each
 * element, so DAHL_OK is returned. */
static dahl_err_t prepare_elements(dahl_node_parallel_t *storage, const dahl_node_parallel_params_t *params)
{
    dahl_slip_params_t slip = {.theta_per_count = params->theta_per_count};
    int32_t err = DAHL_OK;
    storage->bearings = 0;
    for (uint32_t k = 0; k < params->elements; k++) {
        const dahl_params_t one = element_params(params, k);
        if (is_slip(params, k)) {
            slip.sigma0[slip.elements] = one.sigma0;
            slip.Fc[slip.elements] = one.Fc;
            slip.elements++;
        } else {
            err |= dahl_prepare(&storage->plan[storage->bearings], &one);
            storage->bearings++;
        }
    }
    storage->slip.elements = 0;
    return (dahl_err_t)(slip.elements == 0 ? err : err | dahl_slip_prepare(&storage->slip, &slip));
}

dahl_err_t dahl_node_use_parallel(dahl_node_t *node, dahl_node_parallel_t *storage, const dahl_node_parallel_params_t *params)
{
    dahl_err_t err = check_mix(params);
    if (err == DAHL_OK) {
        dahl_params_t sums = {.theta_per_count = params->theta_per_count};
        for (uint32_t k = 0; k < params->elements; k++) {
            sums.sigma0 += params->sigma0[k];
            sums.Fc += params->Fc[k];
        }
        err = prepare_elements(storage, params);
        distribute_shares(storage);
        const uint32_t number = DAHL_FRAMES_MODEL_PARALLEL + params->elements;
        storage->model = (dahl_node_model_t){step_parallel_q30, relax_parallel, number, 0};
        relax_parallel(&storage->model);
        dahl_node_use(node, &storage->model, &sums);
    }
    return err;
}

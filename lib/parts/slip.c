/* SPDX-License-Identifier: MIT */
/** Slip elements. The deflection is an integer x, and one count is 2^shift units. A move is therefore exact: x += n
 * 2^shift, clamped to +-limit. Two values are rounded, once each: the limit, Fc/(sigma0 theta_per_count) 2^shift
 * units in 31 bits, and the weight of a unit in the torque. All errors are thus errors of parameters and never
 * grow. */
#include "dahl_parts.h"

#include "../model/bristle_update.h"
#include "../model/check_params.h"
#include "../model/torque.h"
#include "model.h"
#include "shift.h"

#define SHIFT_MAX 31 /* one count then moves from one limit to the other or further */
#define LIMIT_AT_SHIFT_MAX DAHL_ONE_Q30

static dahl_real_t real_of(float x)
{
    return dahl_real_of(dahl_bits_of(x));
}

/** Write the limit and return the shift, from 1/u = Fc/(sigma0 theta_per_count), the counts from rest to slipping;
 * 2^-20 < 1/u <= 2^30. Only the last rounding is inexact. */
static DAHL_COLD uint32_t write_limit(uint32_t *limit, const dahl_params_t *params)
{
    const dahl_real_t sigma0 = real_of(params->sigma0), Fc = real_of(params->Fc), theta = real_of(params->theta_per_count);
    uint64_t numerator = (uint64_t)Fc.mantissa << 30, denominator = dahl_mul(sigma0.mantissa, theta.mantissa) >> 2;
    int32_t exponent = Fc.exponent - sigma0.exponent - theta.exponent - 32;
    for (; numerator >= denominator; exponent++) {
        numerator >>= 1;
    }
    uint64_t rounded = (dahl_quotient(numerator, denominator, 32) + 1) >> 1;
    if (exponent < 31 - SHIFT_MAX) {
        *limit = LIMIT_AT_SHIFT_MAX;
        return SHIFT_MAX;
    }
    *limit = rounded < DAHL_TOP_BIT ? (uint32_t)rounded : DAHL_TOP_BIT - 1;
    return (uint32_t)(31 - exponent);
}

/** Plan under construction. Fc is in units of 2^exponent. The remainder is the share of an element minus weight
 * times limit. Each member has its own array, since compilers replace a copy of whole elements by memcpy, which a
 * bare link does not have. */
typedef struct {
    uint32_t limit[DAHL_SLIP_MAX];
    uint32_t weight[DAHL_SLIP_MAX];
    uint32_t shift[DAHL_SLIP_MAX];
    uint64_t Fc[DAHL_SLIP_MAX];
    uint64_t remainder[DAHL_SLIP_MAX];
    uint64_t sum;
    int32_t exponent;
} draft_t;

/** Eight values below 2^60 stay below 2^63. */
static DAHL_COLD void sum_Fc(draft_t *draft, const dahl_slip_params_t *params, uint32_t elements)
{
    int32_t largest = real_of(params->Fc[0]).exponent;
    for (uint32_t k = 1; k < elements; k++) {
        int32_t exponent = real_of(params->Fc[k]).exponent;
        largest = exponent > largest ? exponent : largest;
    }
    draft->exponent = largest - 28;
    draft->sum = 0;
    for (uint32_t k = 0; k < elements; k++) {
        dahl_real_t Fc = real_of(params->Fc[k]);
        draft->Fc[k] = dahl_shift_right((uint64_t)Fc.mantissa << 28, (uint32_t)(largest - Fc.exponent));
        draft->sum += draft->Fc[k];
    }
}

/** The torque of an element at its limit is weight times limit. Truncating the weight leaves a remainder. */
static DAHL_COLD void set_weight(draft_t *draft, uint32_t k)
{
    const uint32_t limit = draft->limit[k];
    uint64_t share = dahl_quotient(draft->Fc[k], draft->sum, 62), most = dahl_mul(UINT32_MAX, limit);
    share = share < most ? share : most;
    draft->weight[k] = (uint32_t)dahl_quotient(share, (uint64_t)limit << 32, 32);
    draft->remainder[k] = share - dahl_mul(draft->weight[k], limit);
}

/** Return the element that one more unit of weight brings nearest to its share. */
static DAHL_COLD uint32_t largest_deficit(const draft_t *draft, uint32_t elements)
{
    uint32_t found = 0;
    int64_t most = -(int64_t)DAHL_TOP_BIT; /* below any deficit */
    for (uint32_t k = 0; k < elements; k++) {
        int64_t gain = 2 * (int64_t)draft->remainder[k] - (int64_t)draft->limit[k];
        if (gain > most && draft->weight[k] != UINT32_MAX) {
            most = gain;
            found = k;
        }
    }
    return found;
}

/** Give the remainders to the elements with the largest deficit, so that all elements at their limits give the sum
 * of Fc. */
static DAHL_COLD void distribute_remainders(draft_t *draft, uint32_t elements)
{
    int64_t remainders = 0;
    for (uint32_t k = 0; k < elements; k++) {
        remainders += (int64_t)draft->remainder[k];
    }
    uint32_t k = largest_deficit(draft, elements);
    while (2 * remainders > (int64_t)draft->limit[k]) {
        remainders -= (int64_t)draft->limit[k];
        draft->weight[k]++;
        draft->remainder[k] = 0;
        k = largest_deficit(draft, elements);
    }
}

/** Write each word once, as in prepare.c. Rounding the sum of Fc up to 32 bits centres the truncation in
 * torque.h. */
static DAHL_COLD void write_slip_plan(dahl_slip_plan_t *plan, const draft_t *draft, uint32_t elements)
{
    dahl_wide_t sum = dahl_normalise(draft->sum, draft->exponent);
    uint32_t high = (uint32_t)(sum.mantissa >> 32) + ((uint32_t)sum.mantissa != 0);
    uint64_t full = 0;
    for (uint32_t k = 0; k < elements; k++) {
        plan->element[k].limit = draft->limit[k];
        plan->element[k].weight = draft->weight[k];
        plan->shift[k] = (uint8_t)draft->shift[k];
        full += dahl_mul(draft->weight[k], draft->limit[k]);
    }
    plan->full = full;
    plan->Fc_mantissa = high != 0 ? high : DAHL_TOP_BIT;
    plan->Fc_exponent = sum.exponent + 32 + (high == 0);
    plan->elements = elements;
}

static DAHL_COLD dahl_params_t params_of(const dahl_slip_params_t *params, uint32_t k)
{
    dahl_params_t one;
    one.sigma0 = params->sigma0[k];
    one.Fc = params->Fc[k];
    one.theta_per_count = params->theta_per_count;
    return one;
}

static DAHL_COLD int32_t check_slip(const dahl_slip_params_t *params, uint32_t elements)
{
    int32_t err = DAHL_OK;
    for (uint32_t k = 0; k < elements; k++) {
        dahl_params_t one = params_of(params, k);
        err |= dahl_check_params_by_counts(&one);
    }
    return err;
}

static DAHL_COLD void build_plan(dahl_slip_plan_t *plan, const dahl_slip_params_t *params, uint32_t elements)
{
    draft_t draft;
    sum_Fc(&draft, params, elements);
    for (uint32_t k = 0; k < elements; k++) {
        dahl_params_t one = params_of(params, k);
        draft.shift[k] = write_limit(&draft.limit[k], &one);
        set_weight(&draft, k);
    }
    distribute_remainders(&draft, elements);
    write_slip_plan(plan, &draft, elements);
}

DAHL_COLD dahl_err_t dahl_slip_prepare(dahl_slip_plan_t *plan, const dahl_slip_params_t *params)
{
    const uint32_t elements = params->elements;
    if (elements == 0 || elements > DAHL_SLIP_MAX) {
        return elements == 0 ? DAHL_ERR_PARAM : DAHL_ERR_RANGE;
    }
    int32_t err = check_slip(params, elements);
    if (err == DAHL_OK) {
        build_plan(plan, params, elements);
    }
    return (dahl_err_t)err;
}

/** Return the distance to the limit in direction s, 0 .. 2 limit, with x clamped. Only the rare branch computes the
 * sign of x, which saves one instruction for each element. */
static inline DAHL_ALWAYS_INLINE uint32_t distance_to_limit(uint32_t limit, int32_t x, uint32_t s)
{
    uint32_t distance = dahl_opaque(limit - s * (uint32_t)x);
    if (DAHL_LIKELY(distance <= 2 * limit)) {
        return distance;
    }
    int is_negative = (s * (limit - distance)) >> 31 != 0; /* sign of x */
    return is_negative == (s == 1u) ? 2 * dahl_opaque(limit) : 0;
}

static inline uint32_t distance_after(uint32_t distance, uint32_t counts, uint32_t shift)
{
    return dahl_opaque(counts > distance >> shift ? 0 : distance - (counts << shift));
}

/** Move all elements in direction s = +-1. Return the difference from the torque at which all slip, in Q62. */
static inline DAHL_ALWAYS_INLINE uint64_t move_elements(const dahl_slip_plan_t *plan, int32_t *x, uint32_t counts, uint32_t s)
{
    uint64_t deficit = 0;
    const dahl_slip_element_t *next = plan->element;
    const uint8_t *shift = plan->shift;
    for (uint32_t elements = plan->elements; elements != 0; elements--) {
        const dahl_slip_element_t element = *next++;
        const uint32_t bits = dahl_opaque(*shift++); /* read before the branch; it also saves an instruction */
        uint32_t distance = distance_after(distance_to_limit(element.limit, *x, s), counts, bits);
        *x++ = (int32_t)(s * (element.limit - distance));
        deficit += dahl_mul(distance, element.weight);
    }
    return deficit;
}

static inline DAHL_ALWAYS_INLINE uint64_t move_slip(const dahl_slip_plan_t *plan, dahl_slip_state_t *state, int32_t dcounts)
{
    if (dcounts > 0) {
        return plan->full - move_elements(plan, state->x, (uint32_t)dcounts, 1u);
    }
    return move_elements(plan, state->x, 0u - (uint32_t)dcounts, UINT32_MAX) - plan->full;
}

static dahl_real_t sum_of_Fc(const dahl_slip_plan_t *plan)
{
    dahl_real_t Fc = {plan->Fc_mantissa, plan->Fc_exponent};
    return Fc;
}

float dahl_slip_step_counts(const dahl_slip_plan_t *plan, dahl_slip_state_t *state, int32_t dcounts)
{
    return dahl_torque_from(sum_of_Fc(plan), move_slip(plan, state, dcounts));
}

int32_t dahl_slip_step_counts_q30(const dahl_slip_plan_t *plan, dahl_slip_state_t *state, int32_t dcounts)
{
    return (int32_t)dahl_q30(move_slip(plan, state, dcounts));
}

int64_t dahl_slip_part_move(const void *plan, void *state, int32_t dcounts)
{
    return (int64_t)move_slip((const dahl_slip_plan_t *)plan, (dahl_slip_state_t *)state, dcounts);
}

static DAHL_COLD dahl_err_t prepare_slip(void *plan, const dahl_model_params_t *params)
{
    return dahl_slip_prepare((dahl_slip_plan_t *)plan, &params->each);
}
DAHL_DEFINE_MODEL_BY_COUNTS(slip)

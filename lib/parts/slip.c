/* SPDX-License-Identifier: MIT */
/*
 * Slip elements. The deflection of an element is a whole number x of units, and a count is 2^shift of them, so that no move is
 * rounded: x += n 2^shift, clamped to +-limit. What is rounded is the limit, Fc/(sigma0 theta_per_count) 2^shift units, once, to
 * 31 bits, and the weight of a unit in the torque: so an error is of the parameters, and never grows.
 */
#include "dahl_parts.h"

#include "../model/bristle_update.h"
#include "../model/check_params.h"
#include "../model/torque.h"
#include "shift.h"

#define SHIFT_MOST 31            /* a count is then the way from one limit to the other, or more */
#define LIMIT_OF_SHIFT_MOST DAHL_ONE_Q30

static dahl_real_t real_of(float x)
{
    return dahl_real_of(dahl_bits_of(x));
}

/* Limit, and returns the shift, from 1/u = Fc/(sigma0 theta_per_count), the counts from rest to slipping: 2^-20 < 1/u <= 2^30. All is exact
 * but the last rounding, since floats have mantissas of 24 bits. */
static DAHL_COLD uint32_t write_limit(uint32_t *limit, const dahl_params_t *params)
{
    const dahl_real_t sigma0 = real_of(params->sigma0), Fc = real_of(params->Fc), theta = real_of(params->theta_per_count);
    uint64_t numerator = (uint64_t)Fc.mantissa << 30, denominator = dahl_mul(sigma0.mantissa, theta.mantissa) >> 2;
    int32_t exponent = Fc.exponent - sigma0.exponent - theta.exponent - 32;
    for (; numerator >= denominator; exponent++) {
        numerator >>= 1;
    }
    uint64_t rounded = (dahl_quotient(numerator, denominator, 32) + 1) >> 1;
    if (exponent < 31 - SHIFT_MOST) {
        *limit = LIMIT_OF_SHIFT_MOST;
        return SHIFT_MOST;
    }
    *limit = rounded < DAHL_TOP_BIT ? (uint32_t)rounded : DAHL_TOP_BIT - 1;
    return (uint32_t)(31 - exponent);
}

/* A plan while it is made: of each element its Fc, in units of 2^exponent, and what its weight lacks for its share. (An
 * array for each, since compilers make a memcpy of a loop that copies whole elements, and a bare link has none.) */
typedef struct {
    uint32_t limit[DAHL_SLIP_MAX];
    uint32_t weight[DAHL_SLIP_MAX];
    uint32_t shift[DAHL_SLIP_MAX];
    uint64_t Fc[DAHL_SLIP_MAX];
    uint64_t rest[DAHL_SLIP_MAX];
    uint64_t sum;
    int32_t exponent;
} draft_t;

/* Eight of them, below 2^60 each, stay below 2^63. */
static DAHL_COLD void add_up(draft_t *draft, const dahl_slip_params_t *params, uint32_t elements)
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
        draft->Fc[k] = dahl_shifted_right((uint64_t)Fc.mantissa << 28, (uint32_t)(largest - Fc.exponent));
        draft->sum += draft->Fc[k];
    }
}

/* The torque of an element at its limit is weight times limit. A weight is truncated, which leaves a rest of that torque. */
static DAHL_COLD void weigh(draft_t *draft, uint32_t k)
{
    const uint32_t limit = draft->limit[k];
    uint64_t share = dahl_quotient(draft->Fc[k], draft->sum, 62), most = dahl_mul(UINT32_MAX, limit);
    share = share < most ? share : most;
    draft->weight[k] = (uint32_t)dahl_quotient(share, (uint64_t)limit << 32, 32);
    draft->rest[k] = share - dahl_mul(draft->weight[k], limit);
}

/* The element that a unit more of weight brings nearest to its share. */
static DAHL_COLD uint32_t most_in_need(const draft_t *draft, uint32_t elements)
{
    uint32_t found = 0;
    int64_t most = -(int64_t)DAHL_TOP_BIT; /* less than any */
    for (uint32_t k = 0; k < elements; k++) {
        int64_t need = 2 * (int64_t)draft->rest[k] - (int64_t)draft->limit[k];
        if (need > most && draft->weight[k] != UINT32_MAX) {
            most = need;
            found = k;
        }
    }
    return found;
}

/* The rests go to the elements most in need, so that all of them at their limits have the sum of Fc. */
static DAHL_COLD void share_the_rests(draft_t *draft, uint32_t elements)
{
    int64_t rests = 0;
    for (uint32_t k = 0; k < elements; k++) {
        rests += (int64_t)draft->rest[k];
    }
    uint32_t k = most_in_need(draft, elements);
    while (2 * rests > (int64_t)draft->limit[k]) {
        rests -= (int64_t)draft->limit[k];
        draft->weight[k]++;
        draft->rest[k] = 0;
        k = most_in_need(draft, elements);
    }
}

/* Each word once: who prepares equal parameters again, under a tick that reads the plan, changes nothing at any moment. The sum
 * of Fc is rounded up to 32 bits, which centres the truncation in torque.h. */
static DAHL_COLD void write_plan(dahl_slip_plan_t *plan, const draft_t *draft, uint32_t elements)
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

static DAHL_COLD int32_t check(const dahl_slip_params_t *params, uint32_t elements)
{
    int32_t err = DAHL_OK;
    for (uint32_t k = 0; k < elements; k++) {
        dahl_params_t one = params_of(params, k);
        err |= dahl_check_params_by_counts(&one);
    }
    return err;
}

static DAHL_COLD void make(dahl_slip_plan_t *plan, const dahl_slip_params_t *params, uint32_t elements)
{
    draft_t draft;
    add_up(&draft, params, elements);
    for (uint32_t k = 0; k < elements; k++) {
        dahl_params_t one = params_of(params, k);
        draft.shift[k] = write_limit(&draft.limit[k], &one);
        weigh(&draft, k);
    }
    share_the_rests(&draft, elements);
    write_plan(plan, &draft, elements);
}

DAHL_COLD dahl_err_t dahl_slip_prepare(dahl_slip_plan_t *plan, const dahl_slip_params_t *params)
{
    const uint32_t elements = params->elements;
    if (elements == 0 || elements > DAHL_SLIP_MAX) {
        return elements == 0 ? DAHL_ERR_PARAM : DAHL_ERR_RANGE;
    }
    int32_t err = check(params, elements);
    if (err == DAHL_OK) {
        make(plan, params, elements);
    }
    return (dahl_err_t)err;
}

/* The way to the limit in direction s, 0 .. 2 limit; that of the nearer limit if x is beyond one. Only the rare branch
 * computes the sign of x, which saves an instruction for each element in range. */
static inline DAHL_ALWAYS_INLINE uint32_t room_of(uint32_t limit, int32_t x, uint32_t s)
{
    uint32_t room = dahl_opaque(limit - s * (uint32_t)x);
    if (DAHL_LIKELY(room <= 2 * limit)) {
        return room;
    }
    int is_negative = (s * (limit - room)) >> 31 != 0; /* x */
    return is_negative == (s == 1u) ? 2 * dahl_opaque(limit) : 0;
}

/* The way to the limit that is left of `room` after some counts towards it. */
static inline uint32_t room_after(uint32_t room, uint32_t counts, uint32_t shift)
{
    return dahl_opaque(counts > room >> shift ? 0 : room - (counts << shift));
}

/* Move all elements in direction s = +-1 and return what their torques lack for slipping, in Q62. */
static inline DAHL_ALWAYS_INLINE uint64_t lacking_after(const dahl_slip_plan_t *plan, int32_t *x, uint32_t counts, uint32_t s)
{
    uint64_t lacking = 0;
    const dahl_slip_element_t *next = plan->element;
    const uint8_t *shift = plan->shift;
    for (uint32_t left = plan->elements; left != 0; left--) {
        const dahl_slip_element_t element = *next++;
        const uint32_t bits = dahl_opaque(*shift++); /* read before the branch, for the same reason */
        uint32_t room = room_after(room_of(element.limit, *x, s), counts, bits);
        *x++ = (int32_t)(s * (element.limit - room));
        lacking += dahl_mul(room, element.weight);
    }
    return lacking;
}

/* Move by dcounts and return F / sum of Fc in Q62. */
static inline DAHL_ALWAYS_INLINE uint64_t move(const dahl_slip_plan_t *plan, dahl_slip_state_t *state, int32_t dcounts)
{
    if (dcounts > 0) {
        return plan->full - lacking_after(plan, state->x, (uint32_t)dcounts, 1u);
    }
    return lacking_after(plan, state->x, 0u - (uint32_t)dcounts, UINT32_MAX) - plan->full;
}

static dahl_real_t sum_of_Fc(const dahl_slip_plan_t *plan)
{
    dahl_real_t Fc = {plan->Fc_mantissa, plan->Fc_exponent};
    return Fc;
}

float dahl_slip_step_counts(const dahl_slip_plan_t *plan, dahl_slip_state_t *state, int32_t dcounts)
{
    return dahl_torque_from(sum_of_Fc(plan), move(plan, state, dcounts));
}

int32_t dahl_slip_step_counts_q30(const dahl_slip_plan_t *plan, dahl_slip_state_t *state, int32_t dcounts)
{
    return (int32_t)dahl_q30(move(plan, state, dcounts));
}

int64_t dahl_slip_part_move(const void *plan, void *state, int32_t dcounts)
{
    return (int64_t)move((const dahl_slip_plan_t *)plan, (dahl_slip_state_t *)state, dcounts);
}

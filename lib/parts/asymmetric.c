/* SPDX-License-Identifier: MIT */
/**
 * Friction with one Fc for each direction. The state is w = F / larger Fc. Each direction draws w to its own end,
 * Fc_forward or -Fc_backward, by its own g, since the presliding length Fc/sigma0 differs:
 * @verbatim
 *     z = end - s w        w += s z g         z in Q30, rounded, as in ../model/bristle_update.h
 * @endverbatim
 *
 * @par Range
 * If z is rounded up, w passes the end by less than 2^31, and the next z is 0. A w further beyond is out of range.
 * At exactly 2^31 beyond end_forward it is out of range too, because Q30 would show more than the end. In range, z
 * as an unsigned word is at most the sum of both ends plus a unit or two. Otherwise, except in this one case, it is
 * larger than the sum of their upper words.
 */
#include "../model/bristle_update.h"
#include "../model/check_params.h"
#include "../model/prepare_table.h"
#include "../model/torque.h"
#include "dahl_parts.h"
#include "model.h"

static inline uint32_t gap_forward(const dahl_asymmetric_plan_t *plan, uint64_t w)
{
    return dahl_q30(plan->end_forward - w);
}

static inline uint32_t gap_backward(const dahl_asymmetric_plan_t *plan, uint64_t w)
{
    return dahl_q30(plan->end_backward + w);
}

static inline uint64_t step_forward(uint64_t w, uint64_t end, dahl_q64_t g)
{
    return w + dahl_mul_fraction(dahl_q30(end - w), g.hi, g.lo);
}

static inline uint64_t step_backward(uint64_t w, uint64_t end, dahl_q64_t g)
{
    return w - dahl_mul_fraction(dahl_q30(end + w), g.hi, g.lo);
}

/** Move by the low three bits of counts, then by the digits of base 4. */
static DAHL_COLD uint64_t step_forward_by(const dahl_q64_t *table, uint64_t end, uint64_t w, uint32_t counts)
{
    const dahl_q64_t *g = &table[DAHL_DIRECT_COUNTS_MAX];
    w = step_forward(w, end, table[counts % DAHL_DIRECT_COUNTS_MAX]);
    for (uint32_t digits = counts / DAHL_DIRECT_COUNTS_MAX; digits != 0; digits >>= 2) {
        for (uint32_t times = digits % 4; times != 0; times--) {
            w = step_forward(w, end, *g);
        }
        g++;
    }
    return w;
}

/** Return w. If it is out of range, return the end on its side. A plan of all zeros has no ends. */
static DAHL_COLD uint64_t clamp_asymmetric(const dahl_asymmetric_plan_t *plan, uint64_t w)
{
    if (plan->Fc_mantissa == 0) {
        return dahl_clamp(w);
    }
    if ((int64_t)w >= (int64_t)(plan->end_forward + DAHL_TOP_BIT)) {
        return plan->end_forward;
    }
    return (int64_t)w < -(int64_t)(plan->end_backward + DAHL_TOP_BIT) ? 0u - plan->end_backward : w;
}

static DAHL_COLD DAHL_OUT_OF_LINE uint64_t asymmetric_large(const dahl_asymmetric_plan_t *plan, uint64_t w, int32_t dcounts)
{
    w = clamp_asymmetric(plan, w);
    return dcounts < 0 ? 0u - step_forward_by(plan->backward, plan->end_backward, 0u - w, 0u - (uint32_t)dcounts)
                       : step_forward_by(plan->forward, plan->end_forward, w, (uint32_t)dcounts);
}

/** A z up to this proves that w is in range. A larger z is out of range or near the other end; the large move
 * decides. */
static inline uint32_t max_sure_gap(const dahl_asymmetric_plan_t *plan)
{
    return (uint32_t)(plan->end_forward >> 32) + (uint32_t)(plan->end_backward >> 32);
}

/** The only w out of range whose z is in range: 2^31 beyond the end, where a half is rounded up to z = 0. */
static inline int is_past_end_forward(const dahl_asymmetric_plan_t *plan, uint64_t w)
{
    return gap_forward(plan, w) == 0 && (uint32_t)(plan->end_forward - w) == DAHL_TOP_BIT;
}

static inline DAHL_ALWAYS_INLINE uint64_t asymmetric_move(const dahl_asymmetric_plan_t *plan, uint64_t w, int32_t dcounts)
{
    if (dcounts > 0) {
        if (dcounts > DAHL_DIRECT_COUNTS_MAX || gap_forward(plan, w) > max_sure_gap(plan) || is_past_end_forward(plan, w)) {
            return asymmetric_large(plan, w, dcounts);
        }
        return step_forward(w, plan->end_forward, plan->forward[dcounts]);
    }
    if (dcounts < -DAHL_DIRECT_COUNTS_MAX || gap_backward(plan, w) > max_sure_gap(plan)) {
        return asymmetric_large(plan, w, dcounts);
    }
    return step_backward(w, plan->end_backward, plan->backward[-dcounts]);
}

int32_t dahl_asymmetric_step_counts_q30(const dahl_asymmetric_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint64_t w = asymmetric_move(plan, (uint64_t)state->w, dcounts);
    state->w = (int64_t)w;
    return (int32_t)dahl_q30(w);
}

float dahl_asymmetric_step_counts(const dahl_asymmetric_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    const dahl_real_t Fc = {plan->Fc_mantissa | 1, plan->Fc_exponent};
    uint64_t w = asymmetric_move(plan, (uint64_t)state->w, dcounts);
    state->w = (int64_t)w;
    return plan->Fc_mantissa == 0 ? 0.0f : dahl_torque_from(Fc, w);
}

/** Write the entries of 0, 1 .. 8 counts, then each for four times the counts of the entry before. */
static DAHL_COLD void write_direction(dahl_q64_t *table, int entries, dahl_real_t sigma0, dahl_real_t theta, dahl_real_t Fc)
{
    uint64_t a = dahl_quotient_q63(sigma0.mantissa, Fc.mantissa);
    uint64_t remaining = dahl_remaining_after(dahl_product(a, sigma0.exponent - Fc.exponent - 63, theta));
    dahl_write_table(table, DAHL_DIRECT_COUNTS_MAX + 1, remaining);
    remaining = ~((uint64_t)table[DAHL_DIRECT_COUNTS_MAX].hi << 32 | table[DAHL_DIRECT_COUNTS_MAX].lo);
    for (int n = DAHL_DIRECT_COUNTS_MAX + 1; n < entries; n++) {
        remaining = dahl_join(remaining, remaining);
        remaining = dahl_join(remaining, remaining);
        dahl_write_entry(&table[n], ~remaining);
    }
}

static DAHL_COLD void write_asymmetric(dahl_asymmetric_plan_t *plan, const dahl_asymmetric_params_t *params)
{
    const int entries = (int)(sizeof plan->forward / sizeof plan->forward[0]);
    const dahl_real_t sigma0 = dahl_real_of_float(params->sigma0), theta = dahl_real_of_float(params->theta_per_count);
    const dahl_real_t forward = dahl_real_of_float(params->Fc_forward), backward = dahl_real_of_float(params->Fc_backward);
    plan->end_forward = dahl_ratio_q62(forward, backward);
    plan->end_backward = dahl_ratio_q62(backward, forward);
    const dahl_real_t larger = plan->end_forward == DAHL_ONE_Q62 ? forward : backward;
    plan->Fc_mantissa = larger.mantissa;
    plan->Fc_exponent = larger.exponent;
    write_direction(plan->forward, entries, sigma0, theta, forward);
    write_direction(plan->backward, entries, sigma0, theta, backward);
}

DAHL_COLD dahl_err_t dahl_asymmetric_prepare(dahl_asymmetric_plan_t *plan, const dahl_asymmetric_params_t *params)
{
    const dahl_params_t forward = {params->sigma0, params->Fc_forward, params->theta_per_count};
    const dahl_params_t backward = {params->sigma0, params->Fc_backward, params->theta_per_count};
    int32_t err = dahl_check_params_by_counts(&forward) | dahl_check_params_by_counts(&backward);
    if (err == DAHL_OK) {
        write_asymmetric(plan, params);
    }
    return (dahl_err_t)err;
}

static DAHL_COLD dahl_err_t prepare_asymmetric(void *plan, const dahl_model_params_t *params)
{
    dahl_asymmetric_params_t directed;
    directed.sigma0 = params->each.sigma0[0];
    directed.Fc_forward = params->each.Fc[0];
    directed.Fc_backward = params->each.Fc[1];
    directed.theta_per_count = params->each.theta_per_count;
    return dahl_asymmetric_prepare((dahl_asymmetric_plan_t *)plan, &directed);
}
DAHL_DEFINE_MODEL_BY_COUNTS(asymmetric)

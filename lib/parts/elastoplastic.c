/* SPDX-License-Identifier: MIT */
/**
 * Elasto-plastic element of Dupont, over space.
 *
 * In the direction of travel let x = s w, and let b be the breakaway:
 * @verbatim
 *     x < b       dx/du = 1                  elastic: whole counts are added, so no motion leaves a trace
 *     x >= b      dx/du = kappa (1 - x)      plastic: Dahl's model with kappa sigma0, kappa = 1/(1 - b)
 * @endverbatim
 * If a move crosses b, the kernel computes the rest of its travel, which is not a whole number of counts.
 */
#include "../model/bristle_update.h"
#include "../model/check_params.h"
#include "../model/kernel.h"
#include "../model/prepare_table.h"
#include "../model/torque.h"
#include "dahl_parts.h"
#include "model.h"

#define COARSE_BITS 5 /* the travel of a count is in Q62; if it is 2 or more, in Q57 */

/** Return x = b + (1 - b) g(kappa travel), for travel > 0 beyond b: its 32 leading bits, plus half a bit to centre
 * the truncation. */
static DAHL_OUT_OF_LINE uint64_t plastic_position(const dahl_elastoplastic_plan_t *plan, uint64_t travel)
{
    const uint32_t kappa = plan->plastic.a_mantissa;
    uint32_t high = (uint32_t)(travel >> 32), low = (uint32_t)travel;
    int32_t exponent = plan->plastic.a_exponent + 32;
    if (high == 0) {
        high = low;
        low = 0;
        exponent -= 32;
    }
    uint32_t zeros = dahl_leading_zeros(high);
    uint64_t product = dahl_mul(high << zeros | low >> 1 >> (31 - zeros), kappa) + (kappa >> 1);
    dahl_scaled_t g = dahl_kernel(dahl_scaled_of(product, exponent - (int32_t)zeros));
    g.shift++; /* the gap is in Q31 */
    return (uint64_t)plan->breakaway + dahl_mul_scaled(plan->gap_q31, g);
}

static inline uint64_t move_from_elastic(const dahl_elastoplastic_plan_t *plan, uint64_t x, uint64_t travel)
{
    uint64_t to_breakaway = (uint64_t)plan->breakaway - x;
    return travel <= to_breakaway ? x + travel : plastic_position(plan, travel - to_breakaway);
}

/** Move by one count that travels 2 or more: it ends beyond b from any x. The OR keeps the travel above 0 for an x
 * that no state can produce. */
static uint64_t move_coarse_count(const dahl_elastoplastic_plan_t *plan, uint64_t x)
{
    uint64_t to_breakaway = ((uint64_t)plan->breakaway - x) >> COARSE_BITS;
    return plastic_position(plan, (plan->travel[1] - to_breakaway) | 1);
}

static uint64_t travel_of(const dahl_elastoplastic_plan_t *plan, uint32_t counts)
{
    uint64_t one = plan->travel[1];
    return dahl_mul(counts, (uint32_t)one) + ((uint64_t)(counts * (uint32_t)(one >> 32)) << 32);
}

/** Return w seen in the direction of the move. The function is its own inverse. */
static inline uint64_t in_direction(uint64_t w, int32_t dcounts)
{
    return dcounts < 0 ? 0u - w : w;
}

/** Move until x is beyond b, which at most two steps of counts_max counts reach. Return the remaining counts. */
static uint32_t leave_elastic(const dahl_elastoplastic_plan_t *plan, uint64_t *x, uint32_t remaining)
{
    if (plan->counts_max == 0) {
        *x = move_coarse_count(plan, *x);
        return remaining - 1;
    }
    while (remaining > 0 && (int64_t)*x < plan->breakaway) {
        uint32_t counts = remaining < plan->counts_max ? remaining : plan->counts_max;
        *x = move_from_elastic(plan, *x, travel_of(plan, counts));
        remaining -= counts;
    }
    return remaining;
}

/** Return true if x < b is beyond the other end of the range, even by the allowed 2^31. */
static inline int is_past_end(uint64_t x)
{
    return (uint32_t)(x >> 32) + DAHL_ONE_Q30 >= DAHL_TOP_BIT;
}

/** A move that starts elastic, if it has more counts than the table, or if w may be out of range. */
static DAHL_COLD DAHL_OUT_OF_LINE int32_t elastoplastic_large(const dahl_elastoplastic_plan_t *plan, dahl_state_t *state,
                                                              int32_t dcounts)
{
    state->w = (int64_t)dahl_clamp((uint64_t)state->w);
    uint64_t x = in_direction((uint64_t)state->w, dcounts);
    if (dcounts == 0 || plan->travel[1] == 0) { /* no move, or a plan of all zeros */
        return (int32_t)dahl_q30((uint64_t)state->w);
    }
    uint32_t remaining = leave_elastic(plan, &x, dcounts < 0 ? 0u - (uint32_t)dcounts : (uint32_t)dcounts);
    state->w = (int64_t)in_direction(x, dcounts);
    return dahl_step_large(&plan->plastic, state, (int32_t)(dcounts < 0 ? 0u - remaining : remaining));
}

int32_t dahl_elastoplastic_step_counts_q30(const dahl_elastoplastic_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint64_t x = in_direction((uint64_t)state->w, dcounts);
    uint32_t counts = dcounts < 0 ? 0u - (uint32_t)dcounts : (uint32_t)dcounts;
    if ((int64_t)x >= plan->breakaway) {
        return dahl_step_counts_q30(&plan->plastic, state, dcounts);
    }
    if (counts > plan->direct_counts || is_past_end(x)) {
        return elastoplastic_large(plan, state, dcounts);
    }
    uint64_t w = in_direction(move_from_elastic(plan, x, plan->travel[counts]), dcounts);
    state->w = (int64_t)w;
    return (int32_t)dahl_q30(w);
}

float dahl_elastoplastic_step_counts(const dahl_elastoplastic_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    (void)dahl_elastoplastic_step_counts_q30(plan, state, dcounts);
    return dahl_torque_of(&plan->plastic, (uint64_t)state->w);
}

/** Return b in Q31, rounded, for 0 < b < 1. It is exact if b >= 2^-8. */
static uint32_t breakaway_q31(dahl_real_t b)
{
    int32_t shift = -31 - b.exponent;
    return shift > 32 ? 0 : ((b.mantissa >> (shift - 1)) + 1) >> 1;
}

/** Return the exponent of the unit of plan->travel, 2^exponent presliding lengths, for the travel u of one
 * count. */
static int32_t unit_of(dahl_wide_t u)
{
    return u.exponent < -62 ? -62 : COARSE_BITS - 62;
}

/** Write the plan of the plastic range: Dahl's model with kappa sigma0, for the travel u of a count in presliding
 * lengths. Its a is kappa/ln 2 per unit of travel. */
static DAHL_COLD void write_plastic(dahl_plan_t *plastic, dahl_wide_t u, uint32_t gap_q31)
{
    const dahl_real_t log2_e = {DAHL_LOG2_E_Q31, -31};
    uint32_t zeros = dahl_leading_zeros(gap_q31);
    uint64_t kappa = dahl_quotient_q63(DAHL_TOP_BIT, gap_q31 << zeros);
    int32_t exponent = (int32_t)zeros - 63;
    dahl_wide_t kappa_per_ln2 = dahl_product(kappa, exponent, log2_e);
    plastic->a_mantissa = (uint32_t)(kappa_per_ln2.mantissa >> 32);
    plastic->a_exponent = kappa_per_ln2.exponent + 32 + unit_of(u);
    u = dahl_normalise(dahl_mulhi64(kappa, u.mantissa), exponent + u.exponent + 64);
    dahl_write_table(plastic->g, (int)(sizeof plastic->g / sizeof plastic->g[0]), dahl_remaining_after(u));
}

/** Write the travel u of one count, rounded to a unit, and its multiples below 2, up to 8 counts. A u of 64 or more
 * counts as 32 to 64, which saturates too. As in prepare.c, each word is written once. */
static DAHL_COLD void write_travel(dahl_elastoplastic_plan_t *plan, dahl_wide_t u)
{
    uint64_t half_units = u.mantissa;
    uint32_t counts_max = u.exponent < -62 ? 1 : 0;
    for (int32_t exponent = u.exponent; exponent < unit_of(u) - 1; exponent++) {
        half_units >>= 1;
        counts_max <<= 1;
    }
    const uint32_t direct_counts = counts_max < DAHL_DIRECT_COUNTS_MAX ? counts_max : DAHL_DIRECT_COUNTS_MAX;
    const uint64_t one = (half_units >> 1) + (half_units & 1);
    plan->counts_max = counts_max;
    plan->direct_counts = direct_counts;
    uint64_t travel = 0;
    for (uint32_t n = 0; n <= DAHL_DIRECT_COUNTS_MAX; n++) {
        plan->travel[n] = n <= 1 || n <= direct_counts ? travel : 0;
        travel += one;
    }
}

static DAHL_COLD void write_elastoplastic(dahl_elastoplastic_plan_t *plan, const dahl_params_t *params, uint32_t b_q31)
{
    const dahl_real_t sigma0 = dahl_real_of_float(params->sigma0), Fc = dahl_real_of_float(params->Fc);
    uint64_t a = dahl_quotient_q63(sigma0.mantissa, Fc.mantissa);
    dahl_wide_t u = dahl_product(a, sigma0.exponent - Fc.exponent - 63, dahl_real_of_float(params->theta_per_count));
    plan->plastic.Fc_mantissa = Fc.mantissa;
    plan->plastic.Fc_exponent = Fc.exponent;
    plan->gap_q31 = DAHL_TOP_BIT - b_q31;
    plan->breakaway = (int64_t)((uint64_t)b_q31 << 31);
    write_plastic(&plan->plastic, u, DAHL_TOP_BIT - b_q31);
    write_travel(plan, u);
}

static int32_t check_breakaway(uint32_t bits)
{
    if (bits == 0 || bits >= DAHL_BITS_INF) { /* zero, infinite, NaN, or negative */
        return DAHL_ERR_PARAM;
    }
    return bits < dahl_bits_of(1.0f) ? DAHL_OK : DAHL_ERR_RANGE;
}

DAHL_COLD dahl_err_t dahl_elastoplastic_prepare(dahl_elastoplastic_plan_t *plan, const dahl_params_t *params, float breakaway)
{
    int32_t err = dahl_check_params_by_counts(params) | check_breakaway(dahl_bits_of(breakaway));
    if (err == DAHL_OK) {
        write_elastoplastic(plan, params, breakaway_q31(dahl_real_of_float(breakaway)));
    }
    return (dahl_err_t)err;
}

static DAHL_COLD dahl_err_t prepare_elastoplastic(void *plan, const dahl_model_params_t *params)
{
    const dahl_params_t one = dahl_element_params(params, 0);
    return dahl_elastoplastic_prepare((dahl_elastoplastic_plan_t *)plan, &one, params->own);
}
DAHL_DEFINE_MODEL_BY_COUNTS(elastoplastic)

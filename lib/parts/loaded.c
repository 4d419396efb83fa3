/* SPDX-License-Identifier: MIT */
/** Load that scales Fc and sigma0, so the presliding length and the table of g are constant. If the load c falls, w
 * is kept and F falls with c. If it grows, F is kept: w *= c_before/c_now. Neither increases the energy F^2/(2 c
 * sigma0), nor does rounding, since the product is truncated. */
#include "../arith/scale.h"
#include "../model/bristle_update.h"
#include "../model/torque.h"
#include "dahl_parts.h"
#include "model.h"

#define LOAD_MAX (DAHL_TOP_BIT - 1)
#define MIN_EXPONENT (-64 - 31) /* exponent of Fc = 2^-64 N m as a real */

/** Return 2^46/now rounded down, in at most 16 bits, for 2^30 <= now < 2^31. The first guess is linear in the upper
 * bits of now, with an error of at most 1/12. Two steps of Newton's method reduce it to 1/141 and 1/20000; they end
 * below the exact value. */
static inline uint32_t reciprocal_of(uint32_t now)
{
    uint32_t upper = (now >> 15) + 1, r = 95493u - upper; /* Q16, and Q15 of 1 .. 2 */
    r = r * ((0u - upper * r) >> 16) >> 15;
    return r * ((0u - upper * r) >> 16) >> 15;
}

/** Return the next 32 bits of dividend/divisor, in digits of 8 bits. The reciprocal gives a digit or one less, so
 * the remainder stays below 2 divisor, in 32 bits. */
static inline uint32_t divide_word(uint32_t *dividend, uint32_t divisor, uint32_t reciprocal)
{
    uint32_t word = 0, remainder = *dividend;
    for (int digits = 4; digits > 0; digits--) {
        uint32_t digit = (remainder >> 15) * reciprocal >> 23;
        remainder = (remainder << 8) - digit * divisor;
        if (remainder >= divisor) {
            remainder -= divisor;
            digit++;
        }
        word = word << 8 | digit;
    }
    *dividend = remainder;
    return word;
}

/** Multiply w by before/now, for before < now < 2^31. The result is truncated by at most 3.25 units. */
static DAHL_COLD DAHL_OUT_OF_LINE void increase_load(dahl_loaded_state_t *state, uint32_t now)
{
    uint64_t w = dahl_clamp((uint64_t)state->bristle.w), size = state->bristle.w < 0 ? 0u - w : w;
    uint32_t zeros = dahl_leading_zeros(now) - 1, dividend = state->load_q30 << zeros, divisor = now << zeros;
    uint32_t reciprocal = reciprocal_of(divisor);
    uint32_t ratio_high = divide_word(&dividend, divisor, reciprocal), ratio_low = divide_word(&dividend, divisor, reciprocal);
    size = dahl_mul_fraction((uint32_t)(size >> 32), ratio_high, ratio_low) + dahl_mulhi((uint32_t)size, ratio_high);
    state->bristle.w = (int64_t)(state->bristle.w < 0 ? 0u - size : size);
    state->load_q30 = now;
}

static inline uint32_t clamp_load(uint32_t load_q30)
{
    return load_q30 < LOAD_MAX ? load_q30 : LOAD_MAX;
}

/** Return c Fc, truncated, for c > 0. If c is 1, it is the value that dahl_torque() uses. */
static inline dahl_real_t loaded_Fc(const dahl_plan_t *plan, uint32_t load)
{
    uint32_t zeros = dahl_leading_zeros(load);
    uint64_t product = dahl_mul(load << zeros, plan->Fc_mantissa);
    uint32_t missing = 1 - (uint32_t)(product >> 63);
    dahl_real_t Fc = {(uint32_t)(product << missing >> 32) | 1, plan->Fc_exponent + 2 - (int32_t)(zeros + missing)};
    return Fc;
}

/** Below 2^-32 of c Fc. Since c Fc >= 2^-94 N m, any larger torque is a normal float. */
static int is_small(int64_t w)
{
    return -((int64_t)1 << 30) < w && w < (int64_t)1 << 30;
}

float dahl_loaded_step_counts(const dahl_plan_t *plan, dahl_loaded_state_t *state, int32_t dcounts, uint32_t load_q30)
{
    uint32_t load = clamp_load(load_q30);
    if (load > state->load_q30) {
        increase_load(state, load);
    }
    state->load_q30 = load;
    (void)dahl_step_counts_q30(plan, &state->bristle, dcounts);
    if (load == 0 || plan->Fc_mantissa == 0) {
        return 0.0f;
    }
    dahl_real_t Fc = loaded_Fc(plan, load);
    if (Fc.exponent < MIN_EXPONENT && is_small(state->bristle.w)) {
        return 0.0f;
    }
    return dahl_torque_from(Fc, (uint64_t)state->bristle.w);
}

/** Move and return c w. */
static inline int32_t move_and_scale(const dahl_plan_t *plan, dahl_state_t *bristle, int32_t dcounts, uint32_t load)
{
    return dahl_scale_q30((int32_t)load, dahl_step_counts_q30(plan, bristle, dcounts));
}

static DAHL_COLD DAHL_OUT_OF_LINE int32_t increase_load_and_step(const dahl_plan_t *plan, dahl_loaded_state_t *state,
                                                                 int32_t dcounts, uint32_t load)
{
    increase_load(state, load);
    return move_and_scale(plan, &state->bristle, dcounts, load);
}

int32_t dahl_loaded_step_counts_q30(const dahl_plan_t *plan, dahl_loaded_state_t *state, int32_t dcounts, uint32_t load_q30)
{
    uint32_t load = clamp_load(load_q30);
    if (load > state->load_q30) {
        return increase_load_and_step(plan, state, dcounts, load);
    }
    state->load_q30 = load;
    return move_and_scale(plan, &state->bristle, dcounts, load);
}

static DAHL_COLD dahl_err_t prepare_loaded(void *plan, const dahl_model_params_t *params)
{
    const dahl_params_t one = dahl_element_params(params, 0);
    return dahl_prepare((dahl_plan_t *)plan, &one);
}

static float step_loaded(const void *plan, void *state, int32_t dcounts, uint32_t load_q30)
{
    return dahl_loaded_step_counts((const dahl_plan_t *)plan, (dahl_loaded_state_t *)state, dcounts, load_q30);
}

static int32_t step_loaded_q30(const void *plan, void *state, int32_t dcounts, uint32_t load_q30)
{
    return dahl_loaded_step_counts_q30((const dahl_plan_t *)plan, (dahl_loaded_state_t *)state, dcounts, load_q30);
}

DAHL_DEFINE_MODEL(loaded, dahl_loaded_plan_t, dahl_loaded_state_t)

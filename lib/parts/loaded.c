/* SPDX-License-Identifier: MIT */
/*
 * A load c that both sigma0 and Fc follow in proportion, so that the presliding length, and the table of g, stay. Where the
 * load falls the bristle keeps its deflection: w stays, and F falls with c. Where it grows F stays: w *= c_before/c_now.
 * Both leave the stored energy F^2/(2 c sigma0) no larger; the product is truncated, so that rounding does not either.
 */
#include "../model/bristle_update.h"
#include "../model/torque.h"
#include "dahl_parts.h"

#define LOAD_MAX (DAHL_TOP_BIT - 1)
#define LEAST_EXPONENT (-64 - 31) /* of Fc = 2^-64 N m as a real */

/* 2^46/now rounded down to 16 bits or less, for 2^30 <= now < 2^31: two steps of Newton's method, which end below the value. A
 * first guess that is linear in the upper bits of now errs by 1/12 at most, so these by 1/141 and 1/20000. */
static inline uint32_t reciprocal_of(uint32_t now)
{
    uint32_t upper = (now >> 15) + 1, r = 95493u - upper; /* Q16, and Q15 of 1 .. 2 */
    r = r * ((0u - upper * r) >> 16) >> 15;
    return r * ((0u - upper * r) >> 16) >> 15;
}

/* The next 32 bits of left/now, by digits of 8 bits. A digit is what is left times the reciprocal, which is right or one too
 * small; so what is left stays below 2 now, in 32 bits. */
static inline uint32_t next_word(uint32_t *left, uint32_t now, uint32_t reciprocal)
{
    uint32_t word = 0, rest = *left;
    for (int digits = 4; digits > 0; digits--) {
        uint32_t digit = (rest >> 15) * reciprocal >> 23;
        rest = (rest << 8) - digit * now;
        if (rest >= now) {
            rest -= now;
            digit++;
        }
        word = word << 8 | digit;
    }
    *left = rest;
    return word;
}

/* w before/now for before < now < 2^31: never more, and 3.25 units less at most. */
static DAHL_COLD DAHL_OUT_OF_LINE void take_more_load(dahl_loaded_state_t *state, uint32_t now)
{
    uint64_t w = dahl_clamp((uint64_t)state->bristle.w), size = state->bristle.w < 0 ? 0u - w : w;
    uint32_t zeros = dahl_leading_zeros(now) - 1, left = state->load_q30 << zeros, reciprocal = reciprocal_of(now << zeros);
    uint32_t ratio_high = next_word(&left, now << zeros, reciprocal), ratio_low = next_word(&left, now << zeros, reciprocal);
    size = dahl_mul_fraction((uint32_t)(size >> 32), ratio_high, ratio_low) + dahl_mulhi((uint32_t)size, ratio_high);
    state->bristle.w = (int64_t)(state->bristle.w < 0 ? 0u - size : size);
    state->load_q30 = now;
}

static inline uint32_t load_in_range(uint32_t load_q30)
{
    return load_q30 < LOAD_MAX ? load_q30 : LOAD_MAX;
}

/* c Fc, truncated, for a load that is not 0; at a load of 1 it is what dahl_torque() takes for Fc. */
static inline dahl_real_t loaded_Fc(const dahl_plan_t *plan, uint32_t load)
{
    uint32_t zeros = dahl_leading_zeros(load);
    uint64_t product = dahl_mul(load << zeros, plan->Fc_mantissa);
    uint32_t missing = 1 - (uint32_t)(product >> 63);
    dahl_real_t Fc = {(uint32_t)(product << missing >> 32) | 1, plan->Fc_exponent + 2 - (int32_t)(zeros + missing)};
    return Fc;
}

/* Below 2^-32 of c Fc: with c Fc >= 2^-94 N m, what is not small is a normal float. */
static int is_small(int64_t w)
{
    return -((int64_t)1 << 30) < w && w < (int64_t)1 << 30;
}

float dahl_loaded_step_counts(const dahl_plan_t *plan, dahl_loaded_state_t *state, int32_t dcounts, uint32_t load_q30)
{
    uint32_t load = load_in_range(load_q30);
    if (load > state->load_q30) {
        take_more_load(state, load);
    }
    state->load_q30 = load;
    (void)dahl_step_counts_q30(plan, &state->bristle, dcounts);
    if (load == 0 || plan->Fc_mantissa == 0) {
        return 0.0f;
    }
    dahl_real_t Fc = loaded_Fc(plan, load);
    if (Fc.exponent < LEAST_EXPONENT && is_small(state->bristle.w)) {
        return 0.0f;
    }
    return dahl_torque_from(Fc, (uint64_t)state->bristle.w);
}

/* c w, by c (w + 1) - c: no sign to look at. */
static inline int32_t loaded_q30(const dahl_plan_t *plan, dahl_state_t *bristle, int32_t dcounts, uint32_t load)
{
    uint32_t w = (uint32_t)dahl_step_counts_q30(plan, bristle, dcounts);
    return (int32_t)((uint32_t)((dahl_mul(w + DAHL_ONE_Q30, load) + DAHL_ONE_Q30 / 2) >> 30) - load);
}

static DAHL_COLD DAHL_OUT_OF_LINE int32_t step_with_more_load(const dahl_plan_t *plan, dahl_loaded_state_t *state, int32_t dcounts,
                                                              uint32_t load)
{
    take_more_load(state, load);
    return loaded_q30(plan, &state->bristle, dcounts, load);
}

int32_t dahl_loaded_step_counts_q30(const dahl_plan_t *plan, dahl_loaded_state_t *state, int32_t dcounts, uint32_t load_q30)
{
    uint32_t load = load_in_range(load_q30);
    if (load > state->load_q30) {
        return step_with_more_load(plan, state, dcounts, load);
    }
    state->load_q30 = load;
    return loaded_q30(plan, &state->bristle, dcounts, load);
}

/* SPDX-License-Identifier: MIT */
/*
 * Ticks without end, for the Eva plug-in of Frama-C: any plan, a state that may begin anywhere in its range, and then for
 * ever any call with any argument. Eva follows all of it at once, by intervals: what it does not complain of cannot happen,
 * however long the loop runs. What intervals cannot know is taken from the checks by CBMC (cbmc_core.c), as contracts: where
 * an update ends, what dahl_prepare makes, where the other calls leave the state.
 */
#include <stdint.h>
#include "__fc_builtin.h"
#include "dahl.h"
#include "fixed.h"

#define STATE_END (((int64_t)1 << 62) + ((int64_t)1 << 31))
#define IS_STATE(w) ((uint64_t)(w) < (uint64_t)STATE_END || (uint64_t)(w) >= (uint64_t)-STATE_END)

/* check_normalise */
/*@ requires mantissa > 0 && -0x10000 <= exponent <= 0x10000;
    assigns \result \from mantissa, exponent;
    ensures \result.mantissa >= 0x8000000000000000;
    ensures exponent - 63 <= \result.exponent <= exponent; */
static inline dahl_wide_t dahl_normalise(uint64_t mantissa, int32_t exponent);

/* check_update */
/*@ assigns \result \from w, g;
    behavior in_range:
      assumes IS_STATE(w);
      ensures IS_STATE(\result); */
static inline uint64_t dahl_forward(uint64_t w, dahl_q64_t g);

/*@ requires IS_STATE(w);
    assigns \result \from w, g;
    ensures IS_STATE(\result); */
static inline uint64_t dahl_backward(uint64_t w, dahl_q64_t g);

/* check_step_large; the sides of 0 are told apart for the sake of what comes after */
/*@ requires -STATE_END <= state->w < STATE_END;
    assigns state->w \from state->w, dcounts, *plan;
    assigns \result \from state->w, dcounts, *plan;
    ensures -STATE_END <= state->w < 0 || 0 <= state->w < STATE_END;
    ensures -(1 << 30) <= \result <= (1 << 30); */
int32_t dahl_step_large(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts);

/* check_change_plan */
/*@ requires -STATE_END <= state->w < STATE_END;
    assigns state->w \from state->w, *from, *to;
    ensures -STATE_END <= state->w < STATE_END; */
void dahl_change_plan(const dahl_plan_t *from, const dahl_plan_t *to, dahl_state_t *state);

/* check_set_torque */
/*@ assigns state->w \from F, *plan;
    ensures -STATE_END <= state->w < STATE_END; */
void dahl_set_torque(const dahl_plan_t *plan, dahl_state_t *state, float F);

#include "library.c" /* all of the core (test_frama_c.py writes it) */

volatile int choice;
volatile uint32_t word;

static int32_t any_int32(void)
{
    return (int32_t)word;
}

static dahl_plan_t any_plan(void)
{
    dahl_plan_t plan;
    plan.a_mantissa = DAHL_TOP_BIT | word;
    plan.a_exponent = Frama_C_interval(-159, 97);
    plan.Fc_mantissa = DAHL_TOP_BIT | word;
    plan.Fc_exponent = Frama_C_interval(-95, 32);
    for (int i = 0; i < 37; i++) {
        plan.g[i].hi = word;
        plan.g[i].lo = word;
    }
    return plan;
}

static void call(const dahl_plan_t *plan, const dahl_plan_t *other, dahl_state_t *state)
{
    volatile float F;
    volatile int32_t result;
    switch (choice) {
    case 0: result = dahl_step_counts_q30(plan, state, any_int32()); break;
    case 1: F = dahl_step_counts(plan, state, any_int32()); break;
    case 2: F = dahl_step(plan, state, dahl_float_of(word)); break;
    case 3: F = dahl_torque(plan, state); break;
    case 4: dahl_set_torque(plan, state, dahl_float_of(word)); break;
    case 5: dahl_change_plan(plan, other, state); break;
    case 6: result = dahl_to_units(any_int32(), word); break;
    default: result = dahl_counts_between(word, word, word); break;
    }
}

/* For ever. The sign is looked at outside, so that Eva takes each for itself. */
int main(void)
{
    dahl_plan_t plan = any_plan(), other = any_plan();
    dahl_state_t state = {Frama_C_long_long_interval(-STATE_END, STATE_END - 1)};
    while (choice) {
        if (state.w < 0) {
            call(&plan, &other, &state);
        } else {
            call(&plan, &other, &state);
        }
        //@ check -STATE_END <= state.w < STATE_END;
    }
    return 0;
}

/* What main takes by its contract, for ever; the range of what comes out is CBMC's to show. */
int apart(void)
{
    dahl_plan_t plan = any_plan(), other = any_plan();
    while (choice) {
        dahl_state_t state = {Frama_C_long_long_interval(-STATE_END, STATE_END - 1)};
        (void)dahl_step_large(&plan, &state, any_int32());
        state.w = Frama_C_long_long_interval(-STATE_END, STATE_END - 1);
        dahl_change_plan(&plan, &other, &state);
    }
    return 0;
}

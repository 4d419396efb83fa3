/* SPDX-License-Identifier: MIT */
/*
 * Each public call of the core except dahl_prepare (fuzzed), for any 64 bits as a state, any plan and any argument: no
 * undefined behaviour (CBMC checks it), a final state in range, no other change in memory. One function each, for cbmc
 * --function.
 */
#include "cbmc_ranges.h"

static words_t plan, plan_before;
static guarded_t place, place_before;

static void begin(void)
{
    words_t any_plan;
    guarded_t any_place;
    __CPROVER_assume(is_plan(&any_plan.plan));
    plan = plan_before = any_plan;
    place = place_before = any_place;
}

static void end(void)
{
    uint32_t word;
    __CPROVER_assume(word < sizeof(dahl_plan_t) / 4);
    __CPROVER_assert(is_state(place.state.w), "state in range");
    __CPROVER_assert(place.before == place_before.before && place.after == place_before.after, "memory beside the state");
    __CPROVER_assert(plan.words[word] == plan_before.words[word], "plan as it was");
}

static void is_torque(float F)
{
    uint32_t exponent = dahl_bits_of(F) >> 23 & 255u;
    __CPROVER_assert(exponent != 255u && (exponent != 0u || F == 0.0f), "torque is zero or a normal float");
}

void check_normalise(uint64_t mantissa, int32_t exponent)
{
    __CPROVER_assume(mantissa > 0 && -0x10000 <= exponent && exponent <= 0x10000);
    dahl_wide_t r = dahl_normalise(mantissa, exponent);
    __CPROVER_assert(r.mantissa >> 63 != 0 && exponent - 63 <= r.exponent && r.exponent <= exponent, "top bit set");
}

/* The range theorem: one update of the bristle by any fraction stays in range and moves towards its target. */
void check_update(int64_t w, dahl_q64_t g)
{
    __CPROVER_assume(is_state(w));
    int64_t forward = (int64_t)dahl_forward((uint64_t)w, g), backward = (int64_t)dahl_backward((uint64_t)w, g);
    __CPROVER_assert(is_state(forward) && w <= forward, "forward, in range");
    __CPROVER_assert(is_state(backward) && backward <= w, "backward, in range");
    int32_t q30 = (int32_t)dahl_q30((uint64_t)w);
    __CPROVER_assert(-(1 << 30) <= q30 && q30 <= 1 << 30, "result in range");
}

/* The same by angle, where g is mantissa 2^(-32 - shift). */
void check_update_by_angle(int64_t w, dahl_scaled_t g)
{
    __CPROVER_assume(is_state(w) && 0 <= g.shift && g.shift <= 32);
    int64_t forward = (int64_t)dahl_forward_by_angle((uint64_t)w, g), backward = (int64_t)dahl_backward_by_angle((uint64_t)w, g);
    __CPROVER_assert(is_state(forward) && w <= forward, "forward, in range");
    __CPROVER_assert(is_state(backward) && backward <= w, "backward, in range");
}

void check_step_large(int32_t dcounts)
{
    begin();
    int32_t q30 = dahl_step_large(&plan.plan, &place.state, dcounts);
    end();
    __CPROVER_assert(-(1 << 30) <= q30 && q30 <= 1 << 30, "result in range");
}

/* Replaces dahl_step_large. */
int32_t any_move(const dahl_plan_t *from, dahl_state_t *state, int32_t dcounts)
{
    int32_t q30;
    (void)from;
    (void)dcounts;
    state->w = (int64_t)any_update(0);
    __CPROVER_assume(-(1 << 30) <= q30 && q30 <= 1 << 30);
    return q30;
}

void check_step_counts_q30(int32_t dcounts)
{
    begin();
    int32_t q30 = dahl_step_counts_q30(&plan.plan, &place.state, dcounts);
    end();
    __CPROVER_assert(-(1 << 30) <= q30 && q30 <= 1 << 30, "result in range");
}

void check_step_counts(int32_t dcounts)
{
    begin();
    float F = dahl_step_counts(&plan.plan, &place.state, dcounts);
    end();
    is_torque(F);
}

/* Any float, NaN and infinity included. */
void check_step(uint32_t bits)
{
    begin();
    float F = dahl_step(&plan.plan, &place.state, dahl_float_of(bits));
    end();
    is_torque(F);
}

/* dahl_torque reads any bits as a state in range, and writes no state. */
void check_torque(void)
{
    begin();
    const int64_t w = place.state.w;
    float F = dahl_torque(&plan.plan, &place.state);
    is_torque(F);
    __CPROVER_assert(F == 0.0f || (F < 0) == (w < 0), "the sign of the state");
    __CPROVER_assert((F == 0.0f) == (w == 0 || plan.plan.Fc_mantissa == 0), "zero where the state or the plan is");
    __CPROVER_assert(dahl_state_ok(&place.state) == is_state(w), "in range, or not");
    __CPROVER_assert(w == place_before.state.w, "state as it was");
    place.state.w = 0;
    end();
}

void check_set_torque(uint32_t bits)
{
    begin();
    dahl_set_torque(&plan.plan, &place.state, dahl_float_of(bits));
    end();
}

void check_change_plan(void)
{
    words_t other, other_before;
    __CPROVER_assume(is_plan(&other.plan));
    other_before = other;
    begin();
    dahl_change_plan(&plan.plan, &other.plan, &place.state);
    end();
    uint32_t word;
    __CPROVER_assume(word < sizeof(dahl_plan_t) / 4);
    __CPROVER_assert(other.words[word] == other_before.words[word], "new plan as it was");
}

void check_counts_between(uint32_t before, uint32_t now, uint32_t modulus)
{
    int32_t way = dahl_counts_between(before, now, modulus);
    if (modulus != 0) {
        int64_t twice = 2 * (int64_t)way, n = modulus;
        __CPROVER_assert(-n <= twice && twice < n, "the shortest way");
    } else {
        __CPROVER_assert((uint32_t)way == now - before, "a counter of 32 bits");
    }
}

void check_to_units(int32_t ratio_q30, uint32_t Fc_units)
{
    int32_t units = dahl_to_units(ratio_q30, Fc_units);
    __CPROVER_assert(ratio_q30 != 0 || units == 0, "no torque, no units");
    __CPROVER_assert(Fc_units != 1 || (-2 <= units && units <= 2), "of one unit, two at most: a ratio is below 2");
}

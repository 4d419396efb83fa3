/* SPDX-License-Identifier: MIT */
/*
 * Every public call of the core, for every state, every plan and every argument: no undefined behaviour (CBMC looks for it
 * by itself), the state ends where a state may begin, and nothing else in memory changes. One function each, for
 * cbmc --function. By induction over calls the state then stays in range for ever: see docs/verification.md.
 */
#include "cbmc_ranges.h"

#include "model/step_angle.c"
#include "model/change_plan.c"
#include "model/step_counts.c"
#include "model/step_counts_q30.c"
#include "model/step_large.c"
#include "model/counts_between.c"
#include "model/step_nonfinite.c"
#include "model/prepare.c"
#include "model/set_torque.c"
#include "model/torque.c"
#include "arith/mul_div64.c"

static words_t plan, plan_before;
static guarded_t place, place_before;

static void begin(void)
{
    words_t any_plan;
    guarded_t any_place;
    __CPROVER_assume(is_plan(&any_plan.plan) && is_state(any_place.state.w));
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

/* The upper half is that of the product; the rest takes it for that. */
void check_upper_half(uint32_t a, uint32_t b)
{
    __CPROVER_assert(dahl_mulhi(a, b) == (uint32_t)(dahl_mul(a, b) >> 32), "the same product");
}

/* The range theorem: one update of the bristle, any fraction. */
void check_update(int64_t w, dahl_q64_t g)
{
    __CPROVER_assume(is_state(w));
    __CPROVER_assert(is_state((int64_t)dahl_forward((uint64_t)w, g)), "forward, in range");
    __CPROVER_assert(is_state((int64_t)dahl_backward((uint64_t)w, g)), "backward, in range");
}

void check_move_digits(int32_t dcounts)
{
    begin();
    int32_t q30 = dahl_move_digits(&plan.plan, &place.state, dcounts);
    end();
    __CPROVER_assert(-(1 << 30) <= q30 && q30 <= 1 << 30, "result in range");
}

/* In its place. */
int32_t any_move(const dahl_plan_t *from, dahl_state_t *state, int32_t dcounts)
{
    int32_t q30;
    (void)from;
    (void)dcounts;
    state->w = (int64_t)any_update((uint64_t)state->w);
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

/* Every float: those that are no number, too. */
void check_step(uint32_t bits)
{
    begin();
    float F = dahl_step(&plan.plan, &place.state, dahl_float_of(bits));
    end();
    is_torque(F);
}

void check_torque(void)
{
    begin();
    float F = dahl_torque(&plan.plan, &place.state);
    end();
    is_torque(F);
    __CPROVER_assert(place.state.w == place_before.state.w, "state as it was");
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

/* In the place of dahl_mulhi64, which check_change_plan has whole: what it returns decides nothing but values here. */
uint64_t any_word(uint64_t a, uint64_t b)
{
    uint64_t word;
    (void)a;
    (void)b;
    return word;
}

static int is_shift_of_count(uint32_t shift)
{
    return (44 <= shift && shift <= 93) || shift == 255;
}

/* The table alone; what lies around it is no part of this object. */
static void fill_for(uint32_t shift)
{
    dahl_q64_t table[37];
    table[0].lo = shift;
    fill_table(table);
}

void check_fill_table(void)
{
    for (uint32_t shift = 44; shift <= 93; shift++) {
        fill_for(shift);
    }
    fill_for(255);
}

/* The least and the longest travel of a count, and none. */
void check_fill_table_ends(void)
{
    fill_for(44);
    fill_for(93);
    fill_for(255);
}

/* In the place of fill_table. */
void any_table(dahl_q64_t *table)
{
    words_t any_plan;
    __CPROVER_assert(is_shift_of_count(table[0].lo), "a size that check_fill_table has had");
    memcpy(table, any_plan.plan.g, sizeof any_plan.plan.g);
}

void check_prepare(dahl_params_t params)
{
    begin();
    dahl_err_t err = dahl_prepare(&plan.plan, &params);
    if (err == DAHL_OK) {
        __CPROVER_assert(is_plan(&plan.plan), "what is prepared is a plan");
        __CPROVER_assert(0x1p-64f <= params.sigma0 && params.sigma0 < 0x1p64f, "sigma0 of the range");
        __CPROVER_assert(0x1p-64f <= params.Fc && params.Fc < 0x1p64f, "Fc of the range");
        __CPROVER_assert(0 <= params.theta_per_count && params.theta_per_count < 0x1p64f, "angle of the range");
        plan = plan_before;
    }
    __CPROVER_assert(err == DAHL_OK || err == DAHL_ERR_PARAM || err == DAHL_ERR_RANGE, "a code of the header");
    end();
}

/* The two halves of dahl_two_words are the whole. */
void check_two_words(uint64_t x)
{
    __CPROVER_assert(dahl_two_words(x) == x, "the same number");
}

void check_counts_between(uint32_t before, uint32_t now, uint32_t counts_per_turn)
{
    int32_t way = dahl_counts_between(before, now, counts_per_turn);
    if (counts_per_turn != 0) {
        int64_t twice = 2 * (int64_t)way, n = counts_per_turn;
        __CPROVER_assert(-n <= twice && twice < n, "the shortest way");
    }
}

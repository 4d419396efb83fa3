/* SPDX-License-Identifier: MIT */
/* Ranges of states, plans and products for the proofs by CBMC. A variable without a value may have any value. */
#ifndef CBMC_RANGES_H
#define CBMC_RANGES_H

#include "library.c" /* the core, written by test_cbmc.py */

/* The range theorem: a step from -(2^62 + 2^31) <= w < 2^62 + 2^31 ends in this range. */
#define STATE_END (((int64_t)1 << 62) + ((int64_t)1 << 31))

static int is_state(int64_t w)
{
    return -STATE_END <= w && w < STATE_END;
}

/* A plan as dahl_prepare writes it, or of zeros. The table may have any values. */
static int is_plan(const dahl_plan_t *plan)
{
    if (plan->a_mantissa == 0) {
        return plan->a_exponent == 0 && plan->Fc_mantissa == 0 && plan->Fc_exponent == 0;
    }
    int32_t a_exponent = dahl_a_exponent(plan);
    return plan->a_mantissa >> 31 != 0 && -159 <= a_exponent && a_exponent <= 97
        && dahl_is_far(a_exponent) == (plan->a_exponent != a_exponent) && plan->Fc_mantissa >> 31 != 0
        && (plan->Fc_mantissa & 255u) == 0 && -95 <= plan->Fc_exponent && plan->Fc_exponent <= 32;
}

/* These replace dahl_mul and dahl_mulhi, because decision procedures are slow at multiplication. The proofs use two facts of a
 * product r = a b of two words: a <= 2^32 - 1 gives r <= 2^32 b - b, and a >= 2^31 gives r >= 2^31 b. */
uint64_t any_product(uint32_t factor_a, uint32_t factor_b)
{
    uint64_t a = factor_a, b = factor_b, r;
    __CPROVER_assume(r <= a * 0x100000000 - a && (a < 0x80000000 || r >= b * 0x80000000));
    __CPROVER_assume(r <= b * 0x100000000 - b && (b < 0x80000000 || r >= a * 0x80000000));
    return r;
}

uint32_t any_upper_half(uint32_t a, uint32_t b)
{
    return (uint32_t)(any_product(a, b) >> 32);
}

/* Replaces dahl_forward and dahl_backward, which check_update proves. */
static uint64_t any_update(uint64_t w)
{
    int64_t to;
    __CPROVER_assert(is_state((int64_t)w), "an update begins in range");
    __CPROVER_assume(is_state(to));
    return (uint64_t)to;
}

uint64_t any_forward(uint64_t w, dahl_q64_t g)
{
    (void)g;
    return any_update(w);
}

uint64_t any_backward(uint64_t w, dahl_q64_t g)
{
    (void)g;
    return any_update(w);
}

uint64_t any_forward_by_angle(uint64_t w, dahl_scaled_t g)
{
    __CPROVER_assert(0 <= g.shift && g.shift <= 32, "g has a shift of 0 to 32");
    return any_update(w);
}

uint64_t any_backward_by_angle(uint64_t w, dahl_scaled_t g)
{
    return any_forward_by_angle(w, g);
}

/* A state between guards, which a call must not write. */
typedef struct {
    uint64_t before;
    dahl_state_t state;
    uint64_t after;
} guarded_t;

typedef union {
    dahl_plan_t plan;
    uint32_t words[sizeof(dahl_plan_t) / 4];
} words_t;

#endif

/* SPDX-License-Identifier: MIT */
/* The guarantee of dahl.h: each hard motion, each travel per count, against long double; P10 and P13 with it. */
#include <stdio.h>
#include <unity.h>

#include "motions.h"
#include "reference.h"

#ifndef TEST_TICKS
#define TEST_TICKS 1000000
#endif

static const double travels[] = {1e-8, 1e-6, 1e-4, 1e-2, 0.3, 3.0, 20.0};
#define TRAVELS (sizeof travels / sizeof travels[0])

typedef struct {
    long double torque_ulp;
    long double q30;
} worst_t;

static long double larger(long double a, long double b)
{
    return a > b ? a : b;
}

/* docs/accuracy.md for a travel u of one count; the header has its worst. */
static long double q30_bound(double u)
{
    long double bound = 0x1p-30L + 5 * 0x1p-64L / (long double)u + 0x1p-38L;
    return bound < DAHL_ERROR_Q30 ? bound : DAHL_ERROR_Q30;
}

/* Both results of the counts path, on one motion. */
static worst_t run_counts(const dahl_params_t *p, motion_fn next, int ticks)
{
    dahl_plan_t plan;
    dahl_state_t by_torque, by_q30;
    reference_t exact = reference_by_counts(p);
    motion_t motion = MOTION_START;
    worst_t worst = {0, 0};
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_prepare(&plan, p));
    dahl_set_torque(&plan, &by_torque, 0.9f * p->Fc);
    by_q30 = by_torque;
    exact.w_reversal = (long double)(0.9f * p->Fc) / p->Fc;
    for (int t = 0; t < ticks; t++) {
        int32_t d = next(&motion);
        long double w = reference_move(&exact, d);
        long double torque = dahl_step_counts(&plan, &by_torque, d);
        long double ratio = dahl_step_counts_q30(&plan, &by_q30, d) * (long double)DAHL_Q30;
        worst.torque_ulp = larger(worst.torque_ulp, fabsl(torque - w * p->Fc) / ulp_of(p->Fc));
        worst.q30 = larger(worst.q30, fabsl(ratio - w));
    }
    TEST_ASSERT_TRUE(by_torque.w == by_q30.w);
    return worst;
}

static void check_motion(size_t m)
{
    long double over_all = 0;
    for (size_t i = 0; i < TRAVELS; i++) {
        float Fc = i % 2 ? 2.739f : 0.0371f;
        dahl_params_t p = {(float)(travels[i] * Fc / 3.8e-4), Fc, 3.8e-4f};
        worst_t worst = run_counts(&p, motions[m].next, TEST_TICKS);
        printf("%-8s travel/count %.0e Fc %-6g  worst %.4Lf ulp of Fc, Q30 %.2Le\n", motions[m].name, travels[i], (double)Fc,
               worst.torque_ulp, worst.q30);
        TEST_ASSERT_TRUE_MESSAGE(worst.torque_ulp <= DAHL_ULP_COUNTS, motions[m].name);
        TEST_ASSERT_TRUE_MESSAGE(worst.q30 <= q30_bound(travels[i]), motions[m].name);
        over_all = larger(over_all, worst.torque_ulp);
    }
    TEST_ASSERT_TRUE(over_all > 0.49L); /* half an ulp is the rounding to float: the comparison does compare */
}

static void test_sweep(void) { check_motion(0); }
static void test_dither(void) { check_motion(1); }
static void test_two_forward_one_back(void) { check_motion(2); }
static void test_random_walk(void) { check_motion(3); }
static void test_leaps(void) { check_motion(4); }

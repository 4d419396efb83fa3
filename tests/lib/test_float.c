/* SPDX-License-Identifier: MIT */
/* The literal float form: the same laws with its own bound, and as a cross-check of the core. */
#include <float.h>
#include <stdio.h>

#include "dahl_float.h"
#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 1000000
#endif

static dahl_float_plan_t float_plan_for(const dahl_params_t *p)
{
    dahl_float_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_float_prepare(&plan, p));
    return plan;
}

/* Runs one motion. The bound follows the motion: E for now, and E for each reversal, forgotten as the bristle forgets. */
static long double worst_of_bound(const dahl_params_t *p, motion_fn next, int ticks)
{
    dahl_float_plan_t plan = float_plan_for(p);
    dahl_float_state_t state = {0};
    reference_t exact = reference_by_counts(p);
    motion_t m = MOTION_START;
    long double worst = 0, remembered = 0;
    for (int t = 0; t < ticks; t++) {
        int32_t d = next(&m);
        int direction = exact.direction;
        long double error = fabsl(dahl_float_step_counts(&plan, &state, d) / p->Fc - reference_move(&exact, d));
        remembered = (remembered + (direction != exact.direction)) * expl(-exact.a * fabsl((long double)d));
        error /= (long double)DAHL_FLOAT_ERROR * (1 + remembered);
        worst = error > worst ? error : worst;
    }
    return worst;
}

static void test_bound(void)
{
    long double over_all = 0;
    for (size_t k = 0; k < MOTIONS; k++) {
        for (double u = 1e-8; u < 30; u *= 10) {
            dahl_params_t p = params_for(u, u < 1e-4 ? 1.0f : 2.739f);
            long double worst = worst_of_bound(&p, motions[k].next, TEST_TICKS);
            TEST_ASSERT_TRUE_MESSAGE(worst <= 1, motions[k].name);
            over_all = worst > over_all ? worst : over_all;
        }
    }
    printf("float form: worst %.2Lf of its bound\n", over_all);
    TEST_ASSERT_TRUE(over_all > 0.3L); /* the bound is not slack beyond use */
}

static void test_laws(void)
{
    dahl_params_t p = params_for(0.02, 1.3f);
    dahl_float_plan_t plan = float_plan_for(&p);
    dahl_float_state_t x = {0}, y = {0};
    motion_t m = MOTION_START;
    for (int t = 0; t < TEST_TICKS / 10; t++) {
        int32_t d = motion_walk(&m);
        float F = dahl_float_step_counts(&plan, &x, d);
        TEST_ASSERT_TRUE(F >= -p.Fc && F <= p.Fc);
        TEST_ASSERT_TRUE(dahl_float_step_counts(&plan, &y, -d) == -F);
        TEST_ASSERT_TRUE(dahl_float_step_counts(&plan, &x, 0) == F);
    }
}

/* By angle and by counts the same motion gives the same torque. */
static void test_angle(void)
{
    dahl_params_t p = {250.0f, 1.3f, 0x1p-12f};
    dahl_float_plan_t plan = float_plan_for(&p);
    dahl_float_state_t by_counts = {0}, by_angle = {0};
    motion_t m = MOTION_START;
    for (int t = 0; t < TEST_TICKS / 10; t++) {
        int32_t d = motion_walk(&m);
        float F = dahl_float_step_counts(&plan, &by_counts, d);
        float G = dahl_float_step(&plan, &by_angle, (float)d * p.theta_per_count);
        TEST_ASSERT_TRUE(F == G);
    }
}

static void test_bad_input(void)
{
    dahl_params_t p = {100.0f, 1.0f, 1e-4f}, bad = {100.0f, -1.0f, 1e-4f};
    dahl_float_plan_t plan = float_plan_for(&p);
    dahl_float_state_t state = {0};
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, dahl_float_prepare(&plan, &bad));
    TEST_ASSERT_TRUE(plan.Fc == 1.0f);
    float F = dahl_float_step(&plan, &state, 0.004f);
    TEST_ASSERT_TRUE(dahl_float_step(&plan, &state, NAN) == F && dahl_float_step(&plan, &state, -0.0f) == F);
    TEST_ASSERT_TRUE(dahl_float_step(&plan, &state, HUGE_VALF) == 1.0f && dahl_float_step(&plan, &state, 1e30f) == 1.0f);
    TEST_ASSERT_TRUE(dahl_float_step(&plan, &state, -HUGE_VALF) == -1.0f);
    TEST_ASSERT_TRUE(dahl_float_step_counts(&plan, &state, INT32_MIN) == -1.0f);
    TEST_ASSERT_TRUE(dahl_float_step_counts(&plan, &state, INT32_MIN) == -1.0f);
    TEST_ASSERT_TRUE(dahl_float_step_counts(&plan, &state, 1) > -1.0f);
}

/* One direction for longer than a counter or a float holds, where a presliding length is that long. */
static void test_travel_beyond_its_number(void)
{
    dahl_params_t p = {0x1p-64f, 0x1.fp63f, 0.0f}, slow = {1.0f, 1.0f, 0x1p-30f};
    dahl_float_plan_t plan = float_plan_for(&p), slow_plan = float_plan_for(&slow);
    dahl_float_state_t state = {0}, counted = {0};
    float F = dahl_float_step(&plan, &state, FLT_MAX); /* just one presliding length */
    TEST_ASSERT_TRUE(F < 0.65f * p.Fc);
    double two = -expm1(-2 * (double)FLT_MAX * (double)p.sigma0 / (double)p.Fc);
    TEST_ASSERT_TRUE(fabs((double)dahl_float_step(&plan, &state, FLT_MAX) / (double)p.Fc - two) <= 2 * DAHL_FLOAT_ERROR);
    TEST_ASSERT_TRUE(dahl_float_step(&plan, &state, HUGE_VALF) == p.Fc && dahl_float_step(&plan, &state, 1.0f) == p.Fc);
    TEST_ASSERT_TRUE(dahl_float_step(&plan, &state, -HUGE_VALF) == -p.Fc);
    for (int t = 1; t <= 16; t++) {
        double exact = -expm1(-2.0 * t);
        TEST_ASSERT_TRUE(fabs((double)dahl_float_step_counts(&slow_plan, &counted, INT32_MIN) + exact) <= 3 * DAHL_FLOAT_ERROR);
    }
}

/* A number is used up to its end before what was reached becomes a new start. */
static void test_travel_fills_its_number(void)
{
    dahl_params_t p = {0x1p-64f, 0x1.fp63f, 0.0f}, slow = {1.0f, 1.0f, 0x1p-30f};
    dahl_float_plan_t plan = float_plan_for(&p), slow_plan = float_plan_for(&slow);
    dahl_float_state_t by_angle = {0}, by_counts = {0.25f, 0.0f, UINT32_MAX - 5u, 1};
    (void)dahl_float_step(&plan, &by_angle, FLT_MAX / 2);
    (void)dahl_float_step(&plan, &by_angle, FLT_MAX / 2);
    TEST_ASSERT_TRUE(by_angle.travel == FLT_MAX && by_angle.w_reversal == 0.0f);
    (void)dahl_float_step_counts(&slow_plan, &by_counts, 5);
    TEST_ASSERT_TRUE(by_counts.counts == UINT32_MAX && by_counts.w_reversal == 0.25f);
    (void)dahl_float_step_counts(&slow_plan, &by_counts, 1);
    TEST_ASSERT_TRUE(by_counts.counts == 1 && by_counts.w_reversal > 0.25f);
}

/* No motion leaves every bit: also of the one before the first. */
static void test_no_motion_leaves_the_state(void)
{
    dahl_params_t p = {100.0f, 1.0f, 1e-4f};
    dahl_float_plan_t plan = float_plan_for(&p);
    for (int32_t d = -1; d <= 1; d++) {
        dahl_float_state_t state = {0}, start = {0};
        (void)dahl_float_step_counts(&plan, &state, d);
        start = state;
        (void)dahl_float_step_counts(&plan, &state, 0);
        (void)dahl_float_step(&plan, &state, 0.0f);
        (void)dahl_float_step(&plan, &state, -0.0f);
        (void)dahl_float_step(&plan, &state, NAN);
        TEST_ASSERT_EQUAL_MEMORY(&start, &state, sizeof start);
    }
}

/* The cross-check of the core: two forms that share no code agree within the sum of their bounds. */
static void test_agrees_with_core(void)
{
    dahl_params_t p = params_for(0.3, 0.0371f);
    dahl_float_plan_t plan = float_plan_for(&p);
    dahl_plan_t core = plan_for(&p);
    dahl_float_state_t x = {0};
    dahl_state_t y = {0};
    motion_t m = MOTION_START;
    for (int t = 0; t < TEST_TICKS; t++) {
        int32_t d = motion_leap(&m) >> 20;
        float F = dahl_float_step_counts(&plan, &x, d), G = dahl_step_counts(&core, &y, d);
        TEST_ASSERT_TRUE(fabsl((long double)F - G) <= 4.9L * (long double)DAHL_FLOAT_ERROR * p.Fc + ulp_of(p.Fc));
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_bound);
    RUN_TEST(test_laws);
    RUN_TEST(test_angle);
    RUN_TEST(test_bad_input);
    RUN_TEST(test_travel_beyond_its_number);
    RUN_TEST(test_travel_fills_its_number);
    RUN_TEST(test_no_motion_leaves_the_state);
    RUN_TEST(test_agrees_with_core);
    return UNITY_END();
}

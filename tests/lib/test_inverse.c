/* SPDX-License-Identifier: MIT */
/* dahl_counts_to_torque: each move that it finds is tried, and so is the one that is a count shorter; dahl_tip_torque against tanh
 * in long double (test_laws.c runs such a loop until it repeats). */
#include "dahl_parts.h"
#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TRIES 20000
#else
#define TRIES (TEST_TICKS < 20000 ? TEST_TICKS : 20000)
#endif

static const double travels[] = {1.1e-9, 1e-7, 1e-5, 1e-3, 0.1, 3.0, 20.0};
#define TRAVELS (sizeof travels / sizeof travels[0])

static float after(const dahl_plan_t *plan, dahl_state_t state, int32_t dcounts)
{
    return dahl_step_counts(plan, &state, dcounts);
}

static float random_torque(motion_t *m, float Fc)
{
    return Fc * (float)((int32_t)motion_random(m) >> (motion_random(m) & 7u)) / 2147483648.0f;
}

static void check_one(const dahl_plan_t *plan, const dahl_state_t *state, float F)
{
    int32_t n = 12345;
    float here = dahl_torque(plan, state);
    dahl_state_t before = *state;
    dahl_err_t err = dahl_counts_to_torque(plan, state, F, &n);
    TEST_ASSERT_EQUAL_MEMORY(&before, state, sizeof before);
    if (err != DAHL_OK) {
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, err);
        TEST_ASSERT_EQUAL_INT32(12345, n);
        TEST_ASSERT_TRUE(F > here ? after(plan, *state, INT32_MAX) < F : after(plan, *state, -INT32_MAX) > F);
    } else if (n > 0) {
        TEST_ASSERT_TRUE(here < F && after(plan, *state, n) >= F && after(plan, *state, n - 1) < F);
    } else if (n < 0) {
        TEST_ASSERT_TRUE(F < here && after(plan, *state, n) <= F && after(plan, *state, n + 1) > F);
    } else {
        TEST_ASSERT_TRUE(F == here);
    }
}

static void test_the_least_move_to_a_torque(void)
{
    motion_t m = MOTION_START;
    for (size_t i = 0; i < TRAVELS; i++) {
        dahl_params_t p = params_for(travels[i], 0.5f);
        dahl_plan_t plan = plan_for(&p);
        for (int k = 0; k < TRIES; k++) {
            dahl_state_t state = {0};
            dahl_set_torque(&plan, &state, random_torque(&m, p.Fc));
            check_one(&plan, &state, random_torque(&m, p.Fc));
        }
    }
}

/* The ends, and what stands beside them: where a count changes the torque by a rounding or by nothing. */
static void test_the_ends(void)
{
    for (size_t i = 0; i < TRAVELS; i++) {
        dahl_params_t p = params_for(travels[i], 0.7f);
        dahl_plan_t plan = plan_for(&p);
        const float ends[] = {p.Fc, -p.Fc, nextafterf(p.Fc, 0), -nextafterf(p.Fc, 0), 0.0f, -0.0f, 1e-12f, -1e-12f};
        for (size_t from = 0; from < sizeof ends / sizeof ends[0]; from++) {
            for (size_t to = 0; to < sizeof ends / sizeof ends[0]; to++) {
                dahl_state_t state = {0};
                dahl_set_torque(&plan, &state, ends[from]);
                check_one(&plan, &state, ends[to]);
            }
        }
    }
}

static void test_what_cannot_be_reached_is_refused(void)
{
    dahl_params_t p = params_for(1e-3, 0.5f), slow = params_for(1e-9, 0.5f);
    dahl_plan_t plan = plan_for(&p), fine = plan_for(&slow), zeros = {0};
    dahl_state_t state = {0};
    int32_t n = 7;
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, dahl_counts_to_torque(&plan, &state, NAN, &n));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, dahl_counts_to_torque(&plan, &state, INFINITY, &n));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, dahl_counts_to_torque(&plan, &state, -INFINITY, &n));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, dahl_counts_to_torque(&plan, &state, 0.51f, &n));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, dahl_counts_to_torque(&fine, &state, -0.499f, &n));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, dahl_counts_to_torque(&zeros, &state, 0.1f, &n));
    TEST_ASSERT_EQUAL_INT32(7, n);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_counts_to_torque(&zeros, &state, 0.0f, &n));
    TEST_ASSERT_EQUAL_INT32(0, n);
}

static void test_the_tip_of_a_loop(void)
{
    motion_t m = MOTION_START;
    for (size_t i = 0; i < TRAVELS; i++) {
        dahl_params_t p = params_for(travels[i], 0.5f);
        dahl_plan_t plan = plan_for(&p);
        long double u = reference_by_counts(&p).a;
        for (int k = 0; k < TRIES; k++) {
            uint32_t stroke = motion_random(&m) >> (motion_random(&m) & 31u);
            long double exact = p.Fc * tanhl(u * stroke / 2), error = fabsl(dahl_tip_torque(&plan, stroke) - exact);
            TEST_ASSERT_TRUE(error <= 0x1p-30L * exact + 0.51L * ulp_of((float)exact));
        }
    }
    dahl_params_t p = params_for(1e-3, 0.5f);
    dahl_plan_t plan = plan_for(&p), zeros = {0};
    TEST_ASSERT_TRUE(dahl_tip_torque(&plan, 0) == 0.0f && dahl_tip_torque(&zeros, 1000) == 0.0f);
    TEST_ASSERT_TRUE(dahl_tip_torque(&plan, UINT32_MAX) == p.Fc);
}

/* SPDX-License-Identifier: MIT */
/*
 * The paper's Eqs. 7, 18 and 27 as an oracle, with its errata corrected. A test for each erratum shows the printed form fail.
 * a = sigma0/Fc; theta0 is the start, theta1 the first reversal, theta2 the second.
 */
#include "plans.h"

static long double eq7(long double a, long double theta, long double theta0)
{
    return 1 - expl(-a * (theta - theta0));
}

/* With theta0, which the paper drops from Eq. 13 on. */
static long double eq18(long double a, long double theta, long double theta0, long double theta1)
{
    return -1 + 2 * expl(a * (theta - theta1)) - expl(a * (theta - 2 * theta1 + theta0));
}

static long double eq27(long double a, long double theta, long double theta0, long double theta1, long double theta2)
{
    long double k = 2 - 2 * expl(a * (theta2 - theta1)) + expl(a * (theta2 - 2 * theta1 + theta0));
    return 1 - k * expl(-a * (theta - theta2));
}

/* Walk 50 steps, and add up the exact sum of the float angles. */
static float walk(const dahl_plan_t *plan, dahl_state_t *state, float step, long double *theta)
{
    float F = 0;
    for (int i = 0; i < 50; i++) {
        F = dahl_step(plan, state, step);
        *theta += step;
    }
    return F;
}

static void check_segments(float sigma0, float Fc, long double theta0)
{
    dahl_params_t p = {sigma0, Fc, 0.0f};
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    long double a = (long double)sigma0 / Fc, theta = theta0;
    float F = walk(&plan, &state, 3e-4f, &theta);
    assert_torque(eq7(a, theta, theta0), &p, F, DAHL_ULP_ANGLE);
    long double theta1 = theta;
    F = walk(&plan, &state, -5e-4f, &theta);
    assert_torque(eq18(a, theta, theta0, theta1), &p, F, DAHL_ULP_ANGLE);
    long double theta2 = theta;
    F = walk(&plan, &state, 2e-4f, &theta);
    assert_torque(eq27(a, theta, theta0, theta1, theta2), &p, F, DAHL_ULP_ANGLE);
}

static void test_the_torque_follows_the_three_equations(void)
{
    check_segments(100.0f, 1.0f, 0);
    check_segments(36.5f, 2.7f, 0.015L);
    check_segments(5.0f, 0.04f, -0.3L);
}

/* The first exponent of Eq. 26 has the wrong sign, so it is the logarithm of a negative number. */
static void test_erratum_eq26(void)
{
    long double a = 100, theta1 = 0.02L, theta2 = -0.01L;
    TEST_ASSERT_DOUBLE_WITHIN(0.05, -38.2, (double)(2 - 2 * expl(-a * (theta2 - theta1)) + expl(a * (theta2 - 2 * theta1))));
    TEST_ASSERT_TRUE(2 - 2 * expl(a * (theta2 - theta1)) + expl(a * (theta2 - 2 * theta1)) > 0);
}

/* Eqs. 13 to 18 drop theta0: they give 0.865 instead of 0.393. */
static void test_erratum_theta0(void)
{
    dahl_params_t p = {100.0f, 1.0f, 0.0f};
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    TEST_ASSERT_DOUBLE_WITHIN(5e-4, 0.865, (double)eq7(100, 0.02L, 0));
    TEST_ASSERT_DOUBLE_WITHIN(5e-4, 0.393, (double)eq7(100, 0.02L, 0.015L));
    TEST_ASSERT_DOUBLE_WITHIN(5e-4, 0.393, (double)dahl_step(&plan, &state, 0.02f - 0.015f));
}

/* Eqs. 12 to 17 print Theta0 or Tc in place of sigma0 and Fc; only sigma0/Fc times an angle has no unit. */
static void test_erratum_exponents(void)
{
    dahl_params_t p = {40.0f, 0.5f, 0.0f}, scaled = {80.0f, 1.0f, 0.0f};
    dahl_plan_t plan = plan_for(&p), twice = plan_for(&scaled);
    dahl_state_t x = {0}, y = {0};
    for (int i = 0; i < 100; i++) {
        float d = i % 3 ? 1e-3f : -2.5e-3f;
        TEST_ASSERT_TRUE(2.0f * dahl_step(&plan, &x, d) == dahl_step(&twice, &y, d));
    }
}

/* Eq. 27 as printed, without theta0, overflows a float at large angles; the recursion does not. */
static void test_large_angles_do_not_overflow(void)
{
    const float a = 100.0f, theta1 = -2.0f, theta2 = -3.0f, theta = -2.99f;
    float k = 2.0f - 2.0f * expf(a * (theta2 - theta1)) + expf(a * (theta2 - 2.0f * theta1));
    TEST_ASSERT_TRUE(isinf(1.0f - k * expf(-a * (theta - theta2))));
    dahl_params_t p = {100.0f, 1.0f, 0.0f};
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    (void)dahl_step(&plan, &state, 8.0f);
    (void)dahl_step(&plan, &state, theta2 - theta1);
    assert_torque(eq27(a, theta2 + (long double)0.01f, -10, theta1, theta2), &p, dahl_step(&plan, &state, 0.01f), DAHL_ULP_ANGLE);
}

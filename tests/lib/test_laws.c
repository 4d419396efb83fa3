/* SPDX-License-Identifier: MIT */
/*
 * Closed forms by other roads than reference.h: the steady loop, the travel between two torques, and the paper's Eqs. 7
 * (forward), 18 (after the first reversal) and 27 (after the second), a = sigma0/Fc, theta0 start, theta1 and theta2 reversals.
 */
#include "plans.h"

/* Fact 5: work of one update, without an exponential. */
static long double work_of(const dahl_params_t *p, long double dtheta, long double before, long double after)
{
    long double s = dtheta > 0 ? 1 : -1;
    return p->Fc * fabsl(dtheta) - s * (p->Fc / (long double)p->sigma0) * (after - before);
}

/* Fact 4: the steady loop of amplitude A: tip Fc tanh(aA), energy 4 Fc A - 4 Fc^2/sigma0 tanh(aA); fact 5 adds it up. */
static void test_steady_loop(void)
{
    dahl_params_t p = params_for(0.01, 0.8f);
    dahl_plan_t plan = plan_for(&p);
    long double theta = p.theta_per_count, a = (long double)p.sigma0 / p.Fc;
    for (int32_t half = 1; half < 400; half = half * 3 + 1) {
        dahl_state_t state = {0};
        long double A = half * theta, energy = 0, F = 0, Fmax = p.Fc * tanhl(a * A);
        for (int t = 0; t < 4 * half * 5000; t++) {
            int32_t d = (t / (2 * half)) % 2 ? -1 : 1;
            long double next = dahl_step_counts(&plan, &state, d);
            energy += t >= 4 * half * 4999 ? work_of(&p, d * theta, F, next) : 0;
            F = next;
        }
        assert_torque(-Fmax / p.Fc, &p, (float)F, 0.55);
        long double expected = 4 * p.Fc * A - 4 * p.Fc * (p.Fc / (long double)p.sigma0) * tanhl(a * A);
        TEST_ASSERT_TRUE(fabsl(energy - expected) < 4 * ulp_of(p.Fc) * (A + p.Fc / (long double)p.sigma0));
    }
}

/* Fact 6: the travel that leads from F to F1. */
static void test_travel_between_torques(void)
{
    dahl_params_t p = {40.0f, 0.5f, 0.0f};
    dahl_plan_t plan = plan_for(&p);
    for (int i = -8; i <= 8; i++) {
        for (int s = -1; s <= 1; s += 2) {
            dahl_state_t state = {0};
            float F = (float)i * 0.055f, F1 = s > 0 ? 0.46f : -0.46f;
            dahl_set_torque(&plan, &state, F);
            long double travel = p.Fc / (long double)p.sigma0 * logl((s * (long double)p.Fc - F) / (s * (long double)p.Fc - F1));
            float reached = dahl_step(&plan, &state, (float)(s * travel));
            TEST_ASSERT_TRUE(fabsl((long double)reached - F1) < 2 * ulp_of(p.Fc));
        }
    }
}

static long double eq7(long double a, long double theta, long double theta0)
{
    return 1 - expl(-a * (theta - theta0));
}

/* Eq. 18 with theta0 (erratum: the paper drops it from Eq. 13 on). */
static long double eq18(long double a, long double theta, long double theta0, long double theta1)
{
    return -1 + 2 * expl(a * (theta - theta1)) - expl(a * (theta - 2 * theta1 + theta0));
}

/* Eq. 27 with theta0. */
static long double eq27(long double a, long double theta, long double theta0, long double theta1, long double theta2)
{
    long double k = 2 - 2 * expl(a * (theta2 - theta1)) + expl(a * (theta2 - 2 * theta1 + theta0));
    return 1 - k * expl(-a * (theta - theta2));
}

/* Walks in 50 steps of one float each, so that the float angles add up exactly. */
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

static void test_the_three_equations_of_the_paper(void)
{
    check_segments(100.0f, 1.0f, 0);
    check_segments(36.5f, 2.7f, 0.015L);
    check_segments(5.0f, 0.04f, -0.3L);
}

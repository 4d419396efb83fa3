/* SPDX-License-Identifier: MIT */
/* The exact facts 1 to 8 of the model, for the step by counts and by angle. */
#include "motions.h"
#include "plans.h"

static const double travels[] = {1e-7, 1e-4, 0.02, 0.7, 5.0};
#define TRAVELS (sizeof travels / sizeof travels[0])

/* Fact 1: the sampling rate does not matter. */
static void test_semigroup(void)
{
    for (size_t i = 0; i < TRAVELS; i++) {
        dahl_params_t p = params_for(travels[i], 1.37f);
        dahl_plan_t plan = plan_for(&p);
        for (int32_t n = 1; n < 3000; n += 7) {
            dahl_state_t once = {0}, twice = {0};
            float whole = dahl_step_counts(&plan, &once, n);
            (void)dahl_step_counts(&plan, &twice, n / 3);
            float parts = dahl_step_counts(&plan, &twice, n - n / 3);
            TEST_ASSERT_TRUE(fabsl((long double)whole - parts) <= 1.01L * ulp_of(p.Fc));
        }
    }
}

/* Fact 2: bounds, odd symmetry bit for bit, zero motion is the identity. */
static void test_bounds_and_symmetry(void)
{
    for (size_t i = 0; i < TRAVELS * MOTIONS; i++) {
        dahl_params_t p = params_for(travels[i % TRAVELS], 2.5f);
        dahl_plan_t plan = plan_for(&p);
        dahl_state_t x = {0}, y = {0}, z = {0};
        motion_t m = MOTION_START;
        for (int t = 0; t < 20000; t++) {
            int32_t d = motions[i / TRAVELS].next(&m);
            int32_t mirrored = d == INT32_MIN ? INT32_MAX : -d;
            d = d == INT32_MIN ? -INT32_MAX : d;
            float F = dahl_step_counts(&plan, &x, d);
            int32_t q = dahl_step_counts_q30(&plan, &z, d);
            TEST_ASSERT_TRUE(F >= -p.Fc && F <= p.Fc && q >= -1073741824 && q <= 1073741824);
            TEST_ASSERT_TRUE(dahl_step_counts_q30(&plan, &y, mirrored) == -q && y.w == -x.w && z.w == x.w);
            int64_t before = x.w;
            TEST_ASSERT_TRUE(dahl_step_counts(&plan, &x, 0) == F && x.w == before);
            TEST_ASSERT_TRUE(dahl_step(&plan, &x, -0.0f) == F && x.w == before);
        }
    }
}

/* Fact 2 for angles. */
static void test_angle_symmetry(void)
{
    dahl_params_t p = params_for(0.01, 2.5f);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t x = {0}, y = {0};
    motion_t m = MOTION_START;
    for (int t = 0; t < 100000; t++) {
        float d = ldexpf((float)(int32_t)motion_random(&m), -31 - (int)(motion_random(&m) % 40u));
        float F = dahl_step(&plan, &x, d);
        TEST_ASSERT_TRUE(dahl_step(&plan, &y, -d) == -F && y.w == -x.w);
    }
}

/* Fact 3: slope sigma0 at rest, 2 sigma0 right after a reversal from saturation. */
static void test_slopes(void)
{
    dahl_params_t p = params_for(1e-6, 1.0f);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    double slope = (double)dahl_step_counts(&plan, &state, 1) / (double)p.theta_per_count;
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 * (double)p.sigma0, (double)p.sigma0, slope);
    dahl_set_torque(&plan, &state, p.Fc);
    int64_t top = state.w;
    (void)dahl_step_counts(&plan, &state, -1);
    slope = (double)(top - state.w) * 0x1p-62 * (double)p.Fc / (double)p.theta_per_count;
    TEST_ASSERT_DOUBLE_WITHIN(2e-6 * (double)p.sigma0, 2.0 * (double)p.sigma0, slope);
}

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

/* Fact 7: dither of +-d decays a bias by exp(-2ad) a cycle, to -tanh(ad/2) after its backward half. Also P9. */
static void test_dither_decay(void)
{
    for (size_t i = 0; i < TRAVELS; i++) {
        dahl_params_t p = params_for(travels[i], 1.0f);
        dahl_plan_t plan = plan_for(&p);
        dahl_state_t state = {0};
        long double u = reference_by_counts(&p).a, rest = -tanhl(u / 2);
        dahl_set_torque(&plan, &state, 0.9f);
        for (int cycle = 1; cycle <= 1000000; cycle++) {
            (void)dahl_step_counts_q30(&plan, &state, 1);
            float F = dahl_step_counts(&plan, &state, -1);
            if (cycle % 9973 == 1) {
                assert_torque(rest + (0.9f - rest) * expl(-2 * u * cycle), &p, F, DAHL_ULP_COUNTS);
            }
        }
    }
}

/* Fact 8: what a state errs, a motion in one direction forgets by exp(-u). */
static void test_contraction(void)
{
    for (size_t i = 0; i < TRAVELS; i++) {
        dahl_params_t p = params_for(travels[i], 1.0f);
        dahl_plan_t plan = plan_for(&p);
        dahl_state_t x = {0}, y = {(int64_t)1 << 60};
        long double u = reference_by_counts(&p).a, apart = 0.25L;
        for (int n = 1; n < 200; n++) {
            (void)dahl_step_counts(&plan, &x, n % 3 ? n : -n);
            (void)dahl_step_counts(&plan, &y, n % 3 ? n : -n);
            apart *= expl(-u * n);
            TEST_ASSERT_TRUE(fabsl((long double)(y.w - x.w) * 0x1p-62L - apart) < 1e-9L);
        }
    }
}

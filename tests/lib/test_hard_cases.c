/* SPDX-License-Identifier: MIT */
/* Cases of the design that are somebody's real failure, by their number. Those that hold for every model are in test_accuracy.c (P10
 * and P13 for every motion), test_laws.c (P8, P9, P16) and test_params.c (P14 for parameters, P15). */
#include "motions.h"
#include "plans.h"

#ifndef TEST_FINEST_BITS
#define TEST_FINEST_BITS 24
#endif

/* One update of x from F = 0 leaves the gap exp(-x): Euler gives -2, RK4 1.375, backward Euler .25, trapezoid -.2 at 3. */
static void test_p01_one_update(void)
{
    for (double x = 0.01; x <= 100; x *= 1.05) {
        dahl_params_t p = params_for(x, 1.9f);
        dahl_plan_t plan = plan_for(&p);
        dahl_state_t by_counts = {0}, by_angle = {0};
        long double w = 1 - expl(-reference_by_counts(&p).a);
        assert_torque(w, &p, dahl_step_counts(&plan, &by_counts, 1), DAHL_ULP_COUNTS);
        assert_torque(w, &p, dahl_step(&plan, &by_angle, THETA), DAHL_ULP_ANGLE);
    }
}

/* One state by counts and by angles, as they come: each call has the bound of angles. */
static void test_counts_and_angles_mixed(void)
{
    motion_t m = MOTION_START;
    for (double travel = 2e-9; travel < 10; travel *= 30) {
        dahl_params_t p = params_for(travel, 1.9f);
        dahl_plan_t plan = plan_for(&p);
        dahl_state_t state = {0};
        reference_t exact = reference_by_angle(&p);
        for (int t = 0; t < 20000; t++) {
            const int32_t n = motion_walk(&m);
            const int by_angle = motion_random(&m) % 2 != 0;
            const float dtheta = (float)n * THETA;
            const float F = by_angle ? dahl_step(&plan, &state, dtheta) : dahl_step_counts(&plan, &state, n);
            const long double w = reference_move(&exact, by_angle ? dtheta : (long double)n * THETA);
            assert_torque(w, &p, F, DAHL_ULP_ANGLE);
            TEST_ASSERT_TRUE(dahl_torque(&plan, &state) == F);
            TEST_ASSERT_TRUE(fabsl(dahl_step_counts_q30(&plan, &state, 0) * 0x1p-30L - w) <= 5.8e-9L);
        }
    }
}

/* A sine at 32 samples a cycle; returns the largest |F|/Fc of the last cycle and checks every sample. */
static double sine_peak(float sigma0, double amplitude, int cycles)
{
    dahl_params_t p = {sigma0, 1.0f, 0.0f};
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    reference_t exact = reference_by_angle(&p);
    double before = 0, peak = 0;
    for (int t = 1; t <= 32 * cycles; t++) {
        double now = amplitude * sin(t * 3.14159265358979323846 / 16);
        float d = (float)(now - before);
        before = now;
        float F = dahl_step(&plan, &state, d);
        assert_torque(reference_move(&exact, d), &p, F, DAHL_ULP_ANGLE);
        peak = t > 32 * (cycles - 1) ? fmax(peak, fabs((double)F)) : 0;
    }
    return peak;
}

/* Euler 1e51, RK4 1e34, trapezoid 1.32. */
static void test_p02_coarse_sine(void)
{
    TEST_ASSERT_DOUBLE_WITHIN(1e-7, 1.0, sine_peak(20.0f, 1.0, 20));
}

/* Exact tip of the loop at aA = 1: tanh(1). Euler +4.5 %, backward Euler -4 %. */
static void test_p03_loop_tip(void)
{
    TEST_ASSERT_DOUBLE_WITHIN(1e-7, tanh(1.0), sine_peak(1.0f, 1.0, 40));
}

/* Amplitude 1e-12 rad: 1e-6 of F while F > 1e-12 Fc (1-exp loses 3e-6 even in double). */
static void test_p06_tiny_motion(void)
{
    dahl_params_t p = {100.0f, 1.0f, 0.0f};
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    reference_t exact = reference_by_angle(&p);
    double before = 0;
    int compared = 0;
    for (int t = 1; t <= 32 * 20; t++) {
        double now = 1e-12 * sin(t * 3.14159265358979323846 / 16);
        float d = (float)(now - before), F = dahl_step(&plan, &state, d);
        long double w = reference_move(&exact, d);
        before = now;
        if (fabsl(w) > 1e-12L) {
            TEST_ASSERT_TRUE(fabsl(F / (w * p.Fc) - 1) <= 1e-6L);
            compared++;
        }
    }
    TEST_ASSERT_TRUE(compared > 500);
}

/* The same by counts, 1e-8 of travel a count, and the bound that dahl.h states for motion from rest. */
static void test_p06_tiny_motion_by_counts(void)
{
    dahl_params_t p = params_for(1e-8, 1.0f);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    reference_t exact = reference_by_counts(&p);
    for (int n = 1; n <= 1000; n++) {
        int d = (n / 9) % 2 ? -1 : 1;
        long double w = reference_move(&exact, d), travel = n * exact.a;
        float F = dahl_step_counts(&plan, &state, d);
        long double half_ulp = fabsl(w) * p.Fc * 0x1p-24L, error = fabsl(F - w * p.Fc);
        TEST_ASSERT_TRUE(error <= half_ulp + p.Fc * (0x1p-31L * travel + 0x1p-62L * n));
        TEST_ASSERT_TRUE(fabsl(w) <= 1e-12L || error <= 1e-6L * fabsl(w) * p.Fc);
    }
}

/* No dead band: every count that reverses moves the state towards the new side, at every torque. */
static void test_p07_no_dead_band(void)
{
    for (double u = 1e-8; u < 30; u *= 10) {
        dahl_params_t p = params_for(u, 1.0f);
        dahl_plan_t plan = plan_for(&p);
        for (int i = -99; i <= 99; i++) {
            dahl_state_t state = {0};
            dahl_set_torque(&plan, &state, (float)i * 0.01f);
            for (int d = 1; d >= -3; d -= 2) {
                int64_t before = state.w;
                (void)dahl_step_counts(&plan, &state, d);
                TEST_ASSERT_TRUE(d > 0 ? state.w > before : state.w < before);
            }
        }
    }
}

/* The least travel that counts, v = 2^-64 (kernel.h), is felt where the gap is widest, and half of it nowhere. */
static void test_p07_least_travel_by_angle(void)
{
    dahl_params_t p = {1.0f, 1.0f, 0.0f};
    dahl_plan_t plan = plan_for(&p);
    const int64_t one = (int64_t)1 << 62;
    dahl_state_t low = {-one}, high = {one};
    (void)dahl_step(&plan, &low, 0x1.6p-65f); /* v = 0.99 2^-64 */
    (void)dahl_step(&plan, &high, -0x1.6p-65f);
    TEST_ASSERT_TRUE(low.w == -one && high.w == one);
    (void)dahl_step(&plan, &low, 0x1.64p-65f); /* v = 1.003 2^-64 */
    (void)dahl_step(&plan, &high, -0x1.64p-65f);
    TEST_ASSERT_TRUE(low.w == 1 - one && high.w == one - 1);
}

/* +3 -2 inside one sample looks like +1 and is another path; both are exact for what was fed. */
static void test_p11_hidden_reversal(void)
{
    dahl_params_t p = params_for(0.03, 1.0f);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t seen = {0}, path = {0};
    reference_t exact = reference_by_counts(&p);
    long double u = exact.a;
    float net = dahl_step_counts(&plan, &seen, 1);
    (void)dahl_step_counts(&plan, &path, 3);
    (void)reference_move(&exact, 3);
    float true_torque = dahl_step_counts(&plan, &path, -2);
    assert_torque(reference_move(&exact, -2), &p, true_torque, DAHL_ULP_COUNTS);
    TEST_ASSERT_TRUE(fabsl((long double)net - true_torque) > 0.003L);
    TEST_ASSERT_TRUE(fabsl((long double)net - true_torque) < 2 * p.Fc * -expm1l(-4 * u));
}

/* The shortest way, half of the modulus as negative, readings modulo n: against its definition for small n, and at the ends. */
static void test_p12_wraps(void)
{
    static const struct {
        uint32_t before, now, modulus;
        int32_t way;
    } cases[] = {{4095, 0, 4096, 1}, {0, 4095, 4096, -1}, {0, 2048, 4096, -2048}, {1, 2048, 4096, 2047}, {UINT32_MAX, 1, 0, 2},
                 {3, 0xfffffffeu, 0, -5}, {0, 0x80000000u, 0, INT32_MIN}, {0, 4294967294u, UINT32_MAX, -1}, {5 * 4096 + 4095, 0, 4096, 1},
                 {0, 5 * 4096 + 3, 4096, 3}, {4096, UINT32_MAX - 1, 4096, -2}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        TEST_ASSERT_EQUAL_INT32(cases[i].way, dahl_counts_between(cases[i].before, cases[i].now, cases[i].modulus));
    }
    for (uint32_t n = 1; n < 40; n++) {
        for (uint32_t b = 0; b < n; b++) {
            for (uint32_t c = 0; c < n; c++) {
                int64_t d = dahl_counts_between(b, c, n);
                TEST_ASSERT_TRUE(2 * d >= -(int64_t)n && 2 * d < (int64_t)n && ((int64_t)b + d - c) % (int64_t)n == 0);
            }
        }
    }
}

/* Fixed point, 12 to 24 bits: no stall short of Fc; the last value is Fc itself. */
static void test_p13_no_stall(void)
{
    for (int bits = 12; bits <= TEST_FINEST_BITS; bits += 2) {
        dahl_params_t p = {100.0f, 2.739f, (float)(6.283185307179586 / (1 << bits))};
        dahl_plan_t plan = plan_for(&p);
        dahl_state_t state = {0};
        int32_t ticks = (int32_t)(25.0L / reference_by_counts(&p).a) + 1, q = 0;
        for (int32_t t = 0; t < ticks; t++) {
            q = dahl_step_counts_q30(&plan, &state, 1);
        }
        TEST_ASSERT_EQUAL_INT32(1 << 30, q);
        TEST_ASSERT_TRUE(dahl_torque(&plan, &state) == p.Fc);
        TEST_ASSERT_EQUAL_INT32(-(1 << 30), dahl_step_counts_q30(&plan, &state, INT32_MIN));
        TEST_ASSERT_TRUE(dahl_torque(&plan, &state) == -p.Fc);
    }
}

/* Bad angles: the state is never poisoned, and says what dahl.h says. */
static void test_p14_bad_angles(void)
{
    dahl_params_t p = {100.0f, 1.0f, 0.0f};
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    float F = dahl_step(&plan, &state, 0.004f);
    int64_t before = state.w;
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, NAN) == F && dahl_step(&plan, &state, -NAN) == F);
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, 1e-45f) == F && dahl_step(&plan, &state, -1e-39f) == F);
    TEST_ASSERT_TRUE(dahl_step_counts(&plan, &state, 12345) == F); /* theta_per_count 0: counts are unused */
    TEST_ASSERT_TRUE(state.w == before);
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, 1e30f) == 1.0f && dahl_step(&plan, &state, -1e30f) == -1.0f);
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, HUGE_VALF) == 1.0f && state.w == (int64_t)1 << 62);
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, -HUGE_VALF) == -1.0f && state.w == -((int64_t)1 << 62));
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, 0.01f) < 1.0f);
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, 3.4e38f) == 1.0f && dahl_step(&plan, &state, -3.4e38f) == -1.0f);
}

/* The stiffest bristle would feel a subnormal angle; it counts as none for every bristle. */
static void test_p14_subnormal_angles_for_the_stiffest_bristle(void)
{
    dahl_params_t p = {0x1p63f, DAHL_TORQUE_MIN, 0.0f};
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {4711};
    for (float d = 0x1.fffffcp-127f; d > 0; d /= 2) {
        (void)dahl_step(&plan, &state, d);
        (void)dahl_step(&plan, &state, -d);
        TEST_ASSERT_TRUE(state.w == 4711);
    }
    (void)dahl_step(&plan, &state, 0x1p-126f);
    TEST_ASSERT_TRUE(state.w > 4711);
}

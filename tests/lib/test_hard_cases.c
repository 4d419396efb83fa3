/* SPDX-License-Identifier: MIT */
/* Cases at which other implementations fail, and the ends of input that no random motion meets. */
#include "motions.h"
#include "plans.h"

#ifndef TEST_FINEST_BITS
#define TEST_FINEST_BITS 24
#endif

static void test_counts_and_angles_may_be_mixed(void)
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

/* The bound that dahl.h states for motion from rest. 1 - exp(-u) in double loses 3e-6 of such torques. */
static void test_tiny_motion_keeps_its_relative_accuracy(void)
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

static void test_each_reversing_count_moves_the_state_towards_its_side(void)
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

/* If the gap is widest, travel u moves w by 2 u, and the least move is one unit of 2^-62. */
static void test_the_least_angle_that_moves_the_state(void)
{
    dahl_params_t p = {1.0f, 1.0f, 0.0f};
    dahl_plan_t plan = plan_for(&p);
    const int64_t one = (int64_t)1 << 62;
    dahl_state_t low = {-one}, high = {one};
    (void)dahl_step(&plan, &low, 0x1.fep-64f);
    (void)dahl_step(&plan, &high, -0x1.fep-64f);
    TEST_ASSERT_TRUE(low.w == -one && high.w == one);
    (void)dahl_step(&plan, &low, 0x1.01p-63f);
    (void)dahl_step(&plan, &high, -0x1.01p-63f);
    TEST_ASSERT_TRUE(low.w == 1 - one && high.w == one - 1);
}

/* The shortest way; half of the modulus is negative; readings are modulo n. Small n are compared with the definition. */
static void test_counts_between_is_the_shortest_way(void)
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
        for (uint32_t pair = 0; pair < n * n; pair++) {
            const uint32_t b = pair / n, c = pair % n;
            const int64_t d = dahl_counts_between(b, c, n);
            TEST_ASSERT_TRUE(2 * d >= -(int64_t)n && 2 * d < (int64_t)n && ((int64_t)b + d - c) % (int64_t)n == 0);
        }
    }
}

/* A float state stalls short of Fc on encoders of 20 bits and more. */
static void test_slow_motion_on_a_fine_encoder_reaches_Fc(void)
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
    }
}

/* NaN and subnormal angles keep the state; infinite and huge ones saturate it; without a count, counts keep it. */
static void test_bad_angles_never_spoil_the_state(void)
{
    dahl_params_t p = {100.0f, 1.0f, 0.0f};
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    float F = dahl_step(&plan, &state, 0.004f);
    int64_t before = state.w;
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, NAN) == F && dahl_step(&plan, &state, -NAN) == F);
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, 1e-45f) == F && dahl_step(&plan, &state, -1e-39f) == F);
    TEST_ASSERT_TRUE(dahl_step_counts(&plan, &state, 12345) == F && state.w == before);
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, 1e30f) == 1.0f && dahl_step(&plan, &state, -1e30f) == -1.0f);
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, HUGE_VALF) == 1.0f && state.w == (int64_t)1 << 62);
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, -HUGE_VALF) == -1.0f && state.w == -((int64_t)1 << 62));
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, 0.01f) < 1.0f);
    TEST_ASSERT_TRUE(dahl_step(&plan, &state, 3.4e38f) == 1.0f && dahl_step(&plan, &state, -3.4e38f) == -1.0f);
}

static void test_subnormal_angles_do_not_move_the_stiffest_bristle(void)
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

/* SPDX-License-Identifier: MIT */
/* Cases at which other implementations fail, and the ends of input that no random motion meets. */
#include "motions.h"
#include "plans.h"

#ifndef TEST_FINEST_BITS
#define TEST_FINEST_BITS 24
#endif

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

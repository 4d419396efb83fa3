/* SPDX-License-Identifier: MIT */
/* Cases at which other implementations fail, a plan at the end of its format, and the constants of dahl.h. */
#include "dahl_parts.h"
#include "plans.h"

#define TEXT_OF(x) #x
#define VERSION_OF(major, minor, patch) TEXT_OF(major) "." TEXT_OF(minor) "." TEXT_OF(patch)

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

/* The last bits of this travel are all ones: a unit more would carry into each entry of the plan. */
static void test_a_travel_whose_last_bits_are_ones(void)
{
    dahl_params_t p = {0x1.51d492p-3f, 0x1.37d6eep+0f, 0x1.dffdaap-1f};
    dahl_plan_t plan = plan_for(&p);
    TEST_ASSERT_EQUAL_HEX32(0x1e857baeu, plan.g[1].hi);
    TEST_ASSERT_EQUAL_HEX32(0x94cc33d1u, plan.g[1].lo);
}

/* A limit that rounds up to 2^31, because it slips after 1 - 2^-46 counts; and a sum of Fc of more than 32 bits, all ones. */
static void test_slip_elements_at_the_ends_of_their_format(void)
{
    static const dahl_slip_params_t cases[] = {{1, 0x1.000002p0f, {0x1.000002p0f}, {0x1.000004p0f}},
                                               {2, 0.5f, {1.0f, 0x1p-24f}, {0x1.fffffep0f, 0x1.fffffep-24f}}};
    static const float Fc[] = {0x1.000004p0f, 2.0f};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        dahl_slip_plan_t plan;
        dahl_slip_state_t state = {{0}};
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_slip_prepare(&plan, &cases[i]));
        TEST_ASSERT_TRUE(dahl_slip_step_counts(&plan, &state, 1000) == Fc[i]);
        TEST_ASSERT_TRUE(i == 1 || fabsf(dahl_slip_step_counts(&plan, &state, -1)) <= 0x1p-29f);
        TEST_ASSERT_TRUE(dahl_slip_step_counts(&plan, &state, -1000) == -Fc[i]);
    }
}

static void test_version_and_limits_are_those_of_the_header(void)
{
    TEST_ASSERT_EQUAL_STRING(DAHL_VERSION, VERSION_OF(DAHL_VERSION_MAJOR, DAHL_VERSION_MINOR, DAHL_VERSION_PATCH));
    TEST_ASSERT_TRUE((double)DAHL_TORQUE_MIN == 0x1p-64 && (double)DAHL_TORQUE_MAX == 0x1p64);
    TEST_ASSERT_TRUE(DAHL_TRAVEL_MIN == 0x1p-30 && DAHL_TRAVEL_MAX == 0x1p20);
}

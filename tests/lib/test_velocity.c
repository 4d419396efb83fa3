/* SPDX-License-Identifier: MIT */
/* dahl_velocity_torque against straight lines between the table values in long double. test_prepare_laws.c has its limits. */
#include "dahl_parts.h"
#include "motions.h"
#include "plans.h"

static const uint32_t segments[] = {0, 1, 4, 10, 24};

/* A Stribeck curve: the first value is the largest; it falls below 0 and rises again. A negative scale turns it upside down. */
static dahl_velocity_params_t stribeck(uint32_t segment_bits, float scale)
{
    dahl_velocity_params_t p = {.segment_bits = segment_bits};
    for (int k = 0; k < DAHL_VELOCITY_SEGMENTS; k++) {
        float x = (float)(DAHL_VELOCITY_SEGMENTS - k) / DAHL_VELOCITY_SEGMENTS;
        p.torque[k] = scale * (1.5f * x * x - 0.8f * x - (k == 3 ? 0.1f : 0.0f));
    }
    return p;
}

static long double lines(const dahl_velocity_params_t *p, int32_t dcounts)
{
    long double x = fabsl((long double)dcounts) / (long double)(1u << p->segment_bits);
    int k = x >= DAHL_VELOCITY_SEGMENTS ? DAHL_VELOCITY_SEGMENTS : (int)x;
    long double from = k == 0 ? 0 : p->torque[k - 1];
    long double to = k == DAHL_VELOCITY_SEGMENTS ? from : p->torque[k];
    return (dcounts < 0 ? -1 : 1) * (from + (to - from) * (k == DAHL_VELOCITY_SEGMENTS ? 0 : x - k));
}

static float largest(const dahl_velocity_params_t *p)
{
    float most = 0;
    for (int k = 0; k < DAHL_VELOCITY_SEGMENTS; k++) {
        most = fmaxf(most, fabsf(p->torque[k]));
    }
    return most;
}

static void check(const dahl_velocity_plan_t *plan, const dahl_velocity_params_t *p, int32_t dcounts)
{
    long double exact = lines(p, dcounts);
    float F = dahl_velocity_torque(plan, dcounts);
    TEST_ASSERT_TRUE(fabsl(F - exact) <= 1.5L * 0x1p-30L * largest(p) + 0.51L * ulp_of((float)fabsl(exact)));
    long double of_q30 = dahl_velocity_torque_q30(plan, dcounts) * 0x1p-30L * largest(p);
    TEST_ASSERT_TRUE(fabsl(of_q30 - exact) <= 1.5L * 0x1p-30L * largest(p));
    TEST_ASSERT_TRUE(dcounts == INT32_MIN || dahl_velocity_torque(plan, -dcounts) == -F);
}

static void test_the_torque_is_linear_between_the_values(void)
{
    motion_t m = MOTION_START;
    for (size_t i = 0; i < sizeof segments / sizeof segments[0]; i++) {
        dahl_velocity_params_t p = stribeck(segments[i], i % 2 ? 3e-5f : i % 4 ? 40.0f : -40.0f);
        dahl_velocity_plan_t plan;
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_velocity_prepare(&plan, &p));
        for (int k = 0; k < 100000; k++) {
            check(&plan, &p, (int32_t)motion_random(&m) >> (motion_random(&m) & 31u));
        }
        for (int32_t k = 0; k <= DAHL_VELOCITY_SEGMENTS + 1; k++) {
            check(&plan, &p, k << segments[i]);
        }
        check(&plan, &p, INT32_MAX);
        check(&plan, &p, INT32_MIN);
    }
}

static void test_rest_and_a_plan_of_zeros_give_no_torque(void)
{
    dahl_velocity_params_t p = stribeck(4, 1.0f), none = {.segment_bits = 3};
    dahl_velocity_plan_t plan, zeros = {0};
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_velocity_prepare(&plan, &p));
    TEST_ASSERT_TRUE(dahl_velocity_torque(&plan, 0) == 0.0f);
    TEST_ASSERT_TRUE(dahl_velocity_torque(&zeros, 1000) == 0.0f && dahl_velocity_torque(&zeros, INT32_MIN) == 0.0f);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_velocity_prepare(&plan, &none));
    TEST_ASSERT_TRUE(dahl_velocity_torque(&plan, 100) == 0.0f);
}

static void test_values_2_to_the_31_below_the_largest_are_0(void)
{
    dahl_velocity_params_t p = {.segment_bits = 0, .torque = {0x1p-33f, 0x1p-60f, -0x1p-64f}};
    for (int large = 0; large < 2; large++) {
        dahl_velocity_plan_t plan;
        p.torque[DAHL_VELOCITY_SEGMENTS - 1] = large ? 0x1p63f : 1.0f;
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_velocity_prepare(&plan, &p));
        for (int32_t n = 1; n <= 3; n++) {
            TEST_ASSERT_TRUE(dahl_velocity_torque(&plan, n) == 0.0f && dahl_velocity_torque(&plan, -n) == 0.0f);
        }
        TEST_ASSERT_EQUAL_FLOAT(p.torque[DAHL_VELOCITY_SEGMENTS - 1], dahl_velocity_torque(&plan, DAHL_VELOCITY_SEGMENTS));
    }
}

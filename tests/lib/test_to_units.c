/* SPDX-License-Identifier: MIT */
/* dahl_to_units: the nearest whole number to a ratio of Fc, for every argument; and a motion in uN m against the exact solution. */
#include "dahl_parts.h"
#include "motions.h"
#include "plans.h"
#include "reference.h"

#ifndef TEST_TICKS
#define TEST_TICKS 1000000
#endif

#define ONE_Q30 ((int64_t)1 << 30)

static const int32_t ratios[] = {INT32_MIN, INT32_MIN + 1, -(1 << 30), -(1 << 29), -1, 0, 1, 1 << 29, 1 << 30, INT32_MAX - 1, INT32_MAX};
static const uint32_t wholes[] = {0, 1, 2, 3, 37, 500000, (1u << 30) - 1, 1u << 30, (1u << 30) + 1, 0x80000000u, UINT32_MAX};

/* 2^30 times what the result is away from the product: at most a half, and a half is rounded up. */
static void check_nearest(int32_t ratio, uint32_t Fc_units)
{
    int64_t Fc = Fc_units < ONE_Q30 ? (int64_t)Fc_units : ONE_Q30;
    int64_t off = ratio * Fc - ONE_Q30 * dahl_to_units(ratio, Fc_units);
    TEST_ASSERT_TRUE(-ONE_Q30 / 2 <= off && off < ONE_Q30 / 2);
}

static void test_the_nearest_whole_number(void)
{
    motion_t m = MOTION_START;
    for (size_t i = 0; i < sizeof ratios / sizeof ratios[0]; i++) {
        for (size_t k = 0; k < sizeof wholes / sizeof wholes[0]; k++) {
            check_nearest(ratios[i], wholes[k]);
        }
    }
    for (int t = 0; t < TEST_TICKS; t++) {
        int32_t ratio = (int32_t)motion_random(&m) >> (motion_random(&m) & 31u);
        check_nearest(ratio, motion_random(&m) >> (motion_random(&m) & 31u));
    }
}

static void test_the_ends(void)
{
    TEST_ASSERT_EQUAL_INT32(500000, dahl_to_units(1 << 30, 500000));
    TEST_ASSERT_EQUAL_INT32(-500000, dahl_to_units(-(1 << 30), 500000));
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, dahl_to_units(INT32_MIN, UINT32_MAX));
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, dahl_to_units(INT32_MAX, UINT32_MAX));
    TEST_ASSERT_EQUAL_INT32(0, dahl_to_units(INT32_MAX, 0));
}

/* As the header says: half a unit and the error of the ratio, for any motion. */
static void test_a_motion_in_units(void)
{
    const double travels[] = {1e-6, 0.01, 3.0};
    for (size_t i = 0; i < sizeof travels / sizeof travels[0]; i++) {
        dahl_params_t p = params_for(travels[i], 0.5f);
        dahl_plan_t plan = plan_for(&p);
        dahl_state_t state = {0};
        reference_t exact = reference_by_counts(&p);
        motion_t m = MOTION_START;
        for (int t = 0; t < TEST_TICKS / 10; t++) {
            int32_t n = (int32_t)(motion_random(&m) >> (motion_random(&m) % 32u)) * (motion_random(&m) & 1u ? 1 : -1);
            int32_t F = dahl_to_units(dahl_step_counts_q30(&plan, &state, n), 500000);
            long double should = 500000 * reference_move(&exact, n);
            TEST_ASSERT_TRUE(fabsl((long double)F - should) <= 0.5L + 500000 * (long double)DAHL_ERROR_Q30);
        }
    }
}

/* A load of up to 2 is within the range of the ratio. */
static void test_a_load_too(void)
{
    dahl_params_t p = params_for(0.1, 0.5f);
    dahl_plan_t plan = plan_for(&p);
    dahl_loaded_state_t state = {{0}, 0};
    int32_t ratio = dahl_loaded_step_counts_q30(&plan, &state, 1000000, INT32_MAX);
    TEST_ASSERT_EQUAL_INT32(1000000, dahl_to_units(ratio, 500000));
}

/* SPDX-License-Identifier: MIT */
/* dahl_to_units: the nearest whole number to a ratio of Fc, for every argument. */
#include "dahl_parts.h"
#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 1000000
#endif

#define ONE_Q30 ((int64_t)1 << 30)

static const int32_t ratios[] = {INT32_MIN, INT32_MIN + 1, -(1 << 30), -(1 << 29), -1, 0, 1, 1 << 29, 1 << 30, INT32_MAX - 1, INT32_MAX};
static const uint32_t wholes[] = {0, 1, 2, 3, 37, 500000, (1u << 30) - 1, 1u << 30, (1u << 30) + 1, 0x80000000u, UINT32_MAX};

/* The result is at most half a unit from the product; a half is rounded up. */
static void check_nearest(int32_t ratio, uint32_t Fc_units)
{
    int64_t Fc = Fc_units < ONE_Q30 ? (int64_t)Fc_units : ONE_Q30;
    int64_t off = ratio * Fc - ONE_Q30 * dahl_to_units(ratio, Fc_units);
    TEST_ASSERT_TRUE(-ONE_Q30 / 2 <= off && off < ONE_Q30 / 2);
}

static void test_the_result_is_the_nearest_whole_number(void)
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

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

#define SHAFTS 5

/* The recipe for a coarse unit errs by half a unit, and by 1/16 for each torque. A shift without + 8 is half a unit low. */
static void test_a_sum_in_sixteenths_of_a_unit_is_rounded_once(void)
{
    motion_t m = MOTION_START;
    double sum_of_errors = 0, sum_of_shifts = 0;
    for (int t = 0; t < TEST_TICKS; t++) {
        double exact = 0;
        int32_t sum = 0;
        for (int k = 0; k < SHAFTS; k++) {
            const double Fc = motion_random(&m) * 0x1p-26; /* up to 64 units */
            const int32_t ratio = (int32_t)motion_random(&m) / 2;
            exact += ratio * 0x1p-30 * Fc;
            sum += dahl_to_units(ratio, (uint32_t)(16 * Fc + 0.5));
        }
        const double error = ((sum + 8) >> 4) - exact;
        TEST_ASSERT_TRUE(fabs(error) <= 0.5 + SHAFTS / 16.0 + 1e-6);
        sum_of_errors += error;
        sum_of_shifts += (sum >> 4) - exact;
    }
    TEST_ASSERT_TRUE(fabs(sum_of_errors / TEST_TICKS) < 0.05);
    TEST_ASSERT_TRUE(sum_of_shifts / TEST_TICKS < -0.4);
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

/* SPDX-License-Identifier: MIT */
/*
 * Slip elements: random parameters and the ends of the number format. Congruency, Masing's rule and passivity follow from
 * the exact reference of test_accuracy.c. test_part_laws.c has return-point memory.
 */
#include <stdio.h>
#include <unity.h>

#include "models.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif

#define PLANS (TEST_TICKS < 20000 ? 300 : 20000)

static dahl_slip_plan_t plan_of(const dahl_slip_params_t *params)
{
    dahl_slip_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_slip_prepare(&plan, params));
    return plan;
}

/* Check the bounds on leaps, then both ends: +-2^30, and the sum of Fc if it is a float. Return the worst error in ulp of the
 * sum. */
static long double check_leaps(const dahl_slip_params_t *params, motion_t *m, int ticks)
{
    const dahl_slip_plan_t plan = plan_of(params);
    const long double Fc = slip_reference_Fc(params);
    dahl_slip_state_t state = {{0}}, q30 = {{0}};
    slip_reference_t exact = slip_reference(params);
    long double worst = 0;
    for (int t = 0; t < ticks; t++) {
        int32_t d = motion_leap(m) / 4;
        long double F = slip_reference_move(&exact, d);
        worst = fmaxl(worst, fabsl(dahl_slip_step_counts(&plan, &state, d) - F) / ulp_of_sum(Fc));
        long double ratio = dahl_slip_step_counts_q30(&plan, &q30, d) * (long double)DAHL_Q30;
        TEST_ASSERT_TRUE(fabsl(ratio - F / Fc) <= (long double)DAHL_SLIP_ERROR_Q30);
    }
    TEST_ASSERT_TRUE(worst <= (long double)DAHL_ULP_PARTS);
    (void)dahl_slip_step_counts_q30(&plan, &q30, INT32_MAX); /* twice, because the ends may be 2^31 counts apart */
    (void)dahl_slip_step_counts(&plan, &state, INT32_MAX);
    TEST_ASSERT_EQUAL_INT32(1 << 30, dahl_slip_step_counts_q30(&plan, &q30, INT32_MAX));
    TEST_ASSERT_EQUAL_INT32(-(1 << 30), dahl_slip_step_counts_q30(&plan, &q30, INT32_MIN));
    TEST_ASSERT_TRUE((float)Fc != Fc || dahl_slip_step_counts(&plan, &state, INT32_MAX) == (float)Fc);
    return worst;
}

static float random_mantissa(motion_t *m)
{
    return 1.0f + (float)(motion_random(m) >> 9) * 0x1p-23f;
}

/* A count travels 2^-28 to 2^8; the Fc are within 2^1 to 2^64 of each other. */
static dahl_slip_params_t random_params(motion_t *m)
{
    dahl_slip_params_t params = {motion_random(m) % DAHL_SLIP_MAX + 1, random_mantissa(m), {0}, {0}};
    uint32_t exponents = UINT32_C(1) << motion_random(m) % 7u;
    for (uint32_t k = 0; k < params.elements; k++) {
        params.Fc[k] = ldexpf(random_mantissa(m), (int)(motion_random(m) % exponents) - 32);
        params.sigma0[k] = ldexpf(params.Fc[k] * random_mantissa(m), (int)(motion_random(m) % 35u) - 28);
    }
    return params;
}

static void test_random_parameters_keep_the_bounds(void)
{
    motion_t m = MOTION_START;
    long double worst = 0;
    for (int i = 0; i < PLANS; i++) {
        const dahl_slip_params_t params = random_params(&m);
        worst = fmaxl(worst, check_leaps(&params, &m, 50));
    }
    printf("random parameters: worst %.4Lf ulp of the sum of Fc\n", worst);
    TEST_ASSERT_TRUE(worst > 0.49L);
}

/* Travels to slip at and just below powers of two, shares from 1 to 2^-60, and a sum of Fc with more than 32 bits, all ones. */
static void test_the_ends_of_the_number_format(void)
{
    static const float travels[] = {0x1p-30f, 0x1p-29f, 0x1.fffffep-20f, 1.0f, 0x1.000002p0f, 0x1p10f, 0x1.fffffep19f};
    const dahl_slip_params_t ones = {2, 0.5f, {1.0f, 0x1p-24f}, {0x1.fffffep0f, 0x1.fffffep-24f}};
    motion_t m = MOTION_START;
    for (size_t i = 0; i < sizeof travels / sizeof travels[0]; i++) {
        for (int k = 0; k <= 60; k += 4) {
            dahl_slip_params_t params = {DAHL_SLIP_MAX, 0x1p-30f, {0x1p30f * travels[i]}, {1.0f}};
            for (int j = 1; j < DAHL_SLIP_MAX; j++) {
                params.Fc[j] = ldexpf(1.75f, -k);
                params.sigma0[j] = params.Fc[j] * 0x1p30f * travels[(i + (size_t)j) % 7];
            }
            (void)check_leaps(&params, &m, 300);
        }
    }
    (void)check_leaps(&ones, &m, 300);
    dahl_slip_plan_t plan = plan_of(&ones);
    dahl_slip_state_t state = {{0}}, rest = {{0}};
    TEST_ASSERT_TRUE(dahl_slip_step_counts(&plan, &state, 1000) == 2.0f && dahl_slip_step_counts(&plan, &state, -1000) == -2.0f);
    const dahl_slip_params_t one = {1, 0x1.000002p0f, {0x1.000002p0f}, {0x1.000004p0f}}; /* slips after 1 - 2^-46 counts */
    plan = plan_of(&one);
    TEST_ASSERT_TRUE(dahl_slip_step_counts(&plan, &rest, 1) == one.Fc[0]);
    TEST_ASSERT_TRUE(fabsf(dahl_slip_step_counts(&plan, &rest, -1)) <= 0x1p-29f);
}

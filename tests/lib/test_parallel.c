/* SPDX-License-Identifier: MIT */
/* Mixes: the sum of their torques against the sum of their references, and the shares of the Q30 form.
 * test_accuracy.c has the mix of a Dahl element with slip elements. */
#include <stdio.h>

#include "models.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif

#define PARTS_MOST 8

typedef struct {
    dahl_plan_t plan[PARTS_MOST];
    dahl_state_t state[PARTS_MOST];
    reference_t exact[PARTS_MOST];
    float Fc[PARTS_MOST];
    dahl_part_t part[PARTS_MOST];
    int32_t shares[PARTS_MOST];
    uint32_t count;
    long double sum; /* of Fc */
} mix_t;

static mix_t mix; /* small cores have a small stack */

static void begin(void)
{
    mix.count = 0;
    mix.sum = 0;
}

static void add(double travel, float Fc)
{
    const uint32_t k = mix.count++;
    const dahl_params_t params = params_for(travel, Fc);
    const dahl_part_t part = DAHL_PART(&mix.plan[k], &mix.state[k]);
    mix.plan[k] = plan_for(&params);
    mix.state[k].w = 0;
    mix.exact[k] = reference_by_counts(&params);
    mix.Fc[k] = Fc;
    mix.sum += Fc;
    mix.part[k] = part;
    dahl_parallel_shares(mix.shares, mix.part, mix.count);
}

static long double exact_torque(int32_t dcounts)
{
    long double F = 0;
    for (uint32_t k = 0; k < mix.count; k++) {
        F += reference_move(&mix.exact[k], dcounts) * mix.Fc[k];
    }
    return F;
}

static float step(int32_t dcounts)
{
    return dahl_parallel_step_counts(mix.part, mix.count, dcounts);
}

static int32_t step_q30(int32_t dcounts)
{
    return dahl_parallel_step_counts_q30(mix.part, mix.shares, mix.count, dcounts);
}

/* Both forms in turn. The Q30 bound contains the error of Dahl elements instead of slip elements. Return the worst in ulp of
 * the sum. */
static long double check_motion(motion_fn next, int ticks)
{
    const long double bound = DAHL_PARALLEL_ERROR_Q30(mix.count) - DAHL_SLIP_ERROR_Q30 + DAHL_ERROR_Q30;
    motion_t motion = MOTION_START;
    long double worst = 0;
    for (int t = 0; t < ticks; t++) {
        const int32_t d = next(&motion);
        const long double F = exact_torque(d);
        if (t % 2) {
            TEST_ASSERT_TRUE(fabsl(step_q30(d) * (long double)DAHL_Q30 - F / mix.sum) <= bound);
        } else {
            worst = fmaxl(worst, fabsl(step(d) - F) / ulp_of_sum(mix.sum));
        }
    }
    TEST_ASSERT_TRUE(worst <= (long double)DAHL_ULP_COUNTS);
    return worst;
}

/* The sum of the shares is -2^31. At the ends the ratio is +-2^30 exactly. */
static void check_ends(void)
{
    uint32_t whole = 0;
    for (uint32_t k = 0; k < mix.count; k++) {
        TEST_ASSERT_TRUE(mix.shares[k] <= 0 && fabsl(mix.Fc[k] / mix.sum * 0x1p31L + mix.shares[k]) < 1);
        whole -= (uint32_t)mix.shares[k];
    }
    TEST_ASSERT_EQUAL_HEX32(0x80000000u, whole);
    (void)step(INT32_MIN); /* leaves an error of up to 2^-31, which the next move removes */
    TEST_ASSERT_TRUE(fabsl(step(0) + mix.sum) <= 0.508L * ulp_of_sum(mix.sum));
    TEST_ASSERT_EQUAL_INT32(-(1 << 30), step_q30(INT32_MIN));
    (void)step(INT32_MAX);
    TEST_ASSERT_EQUAL_INT32(1 << 30, step_q30(INT32_MAX));
}

static void test_any_number_of_parts_with_any_Fc(void)
{
    static const uint32_t spreads[] = {1, 8, 40, 96};
    motion_t m = MOTION_START;
    long double over_all = 0;
    for (int i = 0; i < (TEST_TICKS < 20000 ? 200 : TEST_TICKS / 10); i++) {
        begin();
        for (uint32_t left = motion_random(&m) % PARTS_MOST + 1; left > 0; left--) {
            const float mantissa = 1.0f + (float)(motion_random(&m) >> 9) * 0x1p-23f;
            add(pow(10.0, motion_random(&m) * -0x1p-32 * 6), ldexpf(mantissa, (int)(motion_random(&m) % spreads[i % 4]) - 48));
        }
        over_all = fmaxl(over_all, check_motion(motions[(size_t)i % MOTIONS].next, 60));
        check_ends();
    }
    printf("parallel: worst %.4Lf ulp of the sum of Fc\n", over_all);
    TEST_ASSERT_TRUE(over_all > 0.49L);
}

static void test_the_sum_of_a_hundred_parts_does_not_overflow(void)
{
    static dahl_part_t parts[100];
    static int32_t shares[100];
    const dahl_params_t params = {1e3f, 0x1.fffffep0f, 3.8e-4f};
    const dahl_plan_t plan = plan_for(&params);
    dahl_state_t state = {0}; /* shared by all */
    for (int k = 0; k < 100; k++) {
        const dahl_part_t part = DAHL_PART(&plan, &state);
        parts[k] = part;
    }
    TEST_ASSERT_TRUE(dahl_parallel_step_counts(parts, 100, INT32_MAX) == 100 * 0x1.fffffep0f);
    TEST_ASSERT_TRUE(dahl_parallel_step_counts(parts, 100, INT32_MIN) == -100 * 0x1.fffffep0f);
    dahl_parallel_shares(shares, parts, 100);
    TEST_ASSERT_EQUAL_INT32(-(1 << 30), dahl_parallel_step_counts_q30(parts, shares, 100, 0));
}

/* Also if they stand first and the element after them has a smaller exponent. Shares of zeros give 0. */
static void test_plans_of_zeros_do_not_change_the_sum(void)
{
    static const dahl_plan_t zero;
    static const dahl_slip_plan_t zero_slip;
    static const int32_t unprepared[3];
    dahl_state_t none = {0}, ours = {0}, by_q30 = {0};
    dahl_slip_state_t slip_none = {{0}};
    int32_t shares[3], no_share = 1;
    motion_t m = MOTION_START;
    begin();
    add(1e-3, 0x1.5p-50f);
    const dahl_part_t parts[] = {DAHL_PART(&zero, &none), DAHL_PART(&mix.plan[0], &ours), DAHL_SLIP_PART(&zero_slip, &slip_none)};
    dahl_parallel_shares(shares, parts, 3);
    dahl_parallel_shares(&no_share, &parts[2], 1);
    TEST_ASSERT_EQUAL_INT32(0, no_share);
    for (int t = 0; t < 1000; t++) {
        const int32_t d = motion_walk(&m);
        TEST_ASSERT_TRUE(dahl_parallel_step_counts(parts, 3, d) == step(d));
        TEST_ASSERT_TRUE(ours.w == mix.state[0].w);
        TEST_ASSERT_EQUAL_INT32(dahl_step_counts_q30(&mix.plan[0], &by_q30, d), dahl_parallel_step_counts_q30(parts, shares, 3, 0));
        TEST_ASSERT_TRUE(dahl_parallel_step_counts(parts, 1, d) == 0.0f && dahl_parallel_step_counts(parts, 0, d) == 0.0f);
        TEST_ASSERT_EQUAL_INT32(0, dahl_parallel_step_counts_q30(parts, unprepared, 3, 0));
        TEST_ASSERT_EQUAL_INT32(0, dahl_parallel_step_counts_q30(parts, shares, 0, d));
    }
    TEST_ASSERT_TRUE(none.w == 0 && slip_none.x[0] == 0);
}

/* SPDX-License-Identifier: MIT */
/* dahl_work: against the integral of the exact torque over each stroke, in long double, and laws of energy. */
#include <stdio.h>

#include "dahl_parts.h"
#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 1000000
#endif

static const double travels[] = {1e-8, 1e-4, 1e-2, 0.3, 20.0};
#define TRAVELS (sizeof travels / sizeof travels[0])

/* The integral of F dtheta over one stroke from w: F = Fc (s - (s - w) exp(-a x)), so Fc (|x| - s (s - w) (1 - exp(-a |x|))/a). */
static long double stroke_work(const dahl_params_t *p, long double w, int32_t dcounts)
{
    long double a = (long double)p->sigma0 / p->Fc, x = fabsl((long double)dcounts) * p->theta_per_count;
    int s = dcounts < 0 ? -1 : 1;
    return p->Fc * (x + s * (s - w) * expm1l(-a * x) / a);
}

/* What the bound of dahl_parts.h is made of: a part of the result, and a part for each reversal. */
static long double bound(const dahl_params_t *p, long double work, int reversals)
{
    long double energy = (long double)p->Fc * p->Fc / p->sigma0, u = reference_by_counts(p).a;
    return 0.5L * ulp_of((float)fabsl(work)) * (1 + 0x1p-30L) + (reversals + 0.5L) * (u < 4e-8L ? 1.5e-9L : 9.5e-10L) * energy;
}

static void check_motion(const dahl_params_t *p, motion_fn next, int ticks)
{
    dahl_plan_t plan = plan_for(p);
    dahl_state_t state = {0}, q30 = {0};
    dahl_work_t sums = {0}, sums_q30 = {0};
    reference_t exact = reference_by_counts(p);
    motion_t motion = MOTION_START;
    dahl_set_torque(&plan, &state, 0.875f * p->Fc); /* some of which may come back */
    q30 = state;
    long double work = 0, w = exact.w_reversal = (long double)(0.875f * p->Fc) / p->Fc;
    int reversals = 0, direction = 0;
    for (int t = 0; t < ticks; t++) {
        int32_t d = next(&motion);
        dahl_state_t alone = state;
        work += stroke_work(p, w, d);
        w = reference_move(&exact, d);
        reversals += d != 0 && (d > 0 ? 1 : -1) == -direction;
        direction = d == 0 ? direction : (d > 0 ? 1 : -1);
        TEST_ASSERT_TRUE(dahl_work_step_counts(&plan, &state, &sums, d) == dahl_step_counts(&plan, &alone, d));
        TEST_ASSERT_TRUE(state.w == alone.w);
        dahl_state_t before = q30;
        TEST_ASSERT_EQUAL_INT32(dahl_step_counts_q30(&plan, &before, d), dahl_work_step_counts_q30(&plan, &q30, &sums_q30, d));
        TEST_ASSERT_TRUE(q30.w == state.w);
        TEST_ASSERT_EQUAL_MEMORY(&sums, &sums_q30, sizeof sums);
        if ((t & (t - 1)) == 0 || t == ticks - 1) { /* at 1, 2, 4 ... ticks */
            TEST_ASSERT_TRUE(fabsl(dahl_work(p, &sums) - work) <= bound(p, work, reversals));
        }
    }
}

static void test_work_is_the_integral_of_the_torque(void)
{
    for (size_t i = 0; i < TRAVELS; i++) {
        dahl_params_t p = params_for(travels[i], i % 2 ? 2.739f : 0.0371f);
        for (size_t m = 0; m < MOTIONS; m++) {
            check_motion(&p, motions[m].next, TEST_TICKS < 20000 ? TEST_TICKS : TEST_TICKS / 20);
        }
    }
}

/* A few fine counts one way: no reversal, but the state is rounded, and the work is as small as that. */
static void test_a_way_without_a_reversal_has_an_error_too(void)
{
    const dahl_params_t p = params_for(1e-8, 0.5f);
    const dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    dahl_work_t sums = {{0}, {0}};
    long double worst = 0;
    for (int n = 1; n <= 50; n++) {
        (void)dahl_work_step_counts_q30(&plan, &state, &sums, 1);
        const long double work = stroke_work(&p, 0, n), error = fabsl(dahl_work(&p, &sums) - work);
        TEST_ASSERT_TRUE(error <= bound(&p, work, 0));
        worst = fmaxl(worst, error / ulp_of((float)work));
    }
    TEST_ASSERT_TRUE(worst > 100);
}

/* Least of what the work is above -F^2/(2 sigma0) of the start, as a fraction of Fc times the way. */
static long double least_work(const dahl_params_t *p, float start, motion_t *m, uint32_t amplitude)
{
    const dahl_plan_t plan = plan_for(p);
    dahl_state_t state = {0};
    dahl_work_t sums = {{0}, {0}};
    long double way = 0, least = 0;
    dahl_set_torque(&plan, &state, start);
    for (int t = 0; t < 400; t++) {
        int32_t d = (int32_t)(motion_random(m) % amplitude) + 1;
        d = amplitude == 1 ? 1 - t % 2 * 2 : motion_random(m) & 64u ? d : -d;
        (void)dahl_work_step_counts_q30(&plan, &state, &sums, d);
        way += fabsl((long double)d) * p->theta_per_count;
        const float work = dahl_work(p, &sums); /* rounded to a float */
        const long double spent = work + 0.5L * ulp_of(fabsf(work)) + (long double)start * start / (2 * (long double)p->sigma0);
        least = fminl(least, spent / (p->Fc * way));
    }
    return least;
}

/* From rest, and with energy to give back: none is made but by rounding, and that does make some. */
static void test_work_is_not_negative_but_for_rounding(void)
{
    motion_t m = MOTION_START;
    long double least = 0;
    for (int k = 0; k < (TEST_TICKS < 100000 ? 100 : TEST_TICKS / 1000); k++) {
        const dahl_params_t p = params_for(pow(2.0, motion_random(&m) * 0x1p-32 * 20 - 29.9), 0.7f);
        const float start = k % 2 ? 0.0f : p.Fc * (float)(int32_t)motion_random(&m) * 0x1p-31f * 0x1p-9f;
        least = fminl(least, least_work(&p, start, &m, UINT32_C(1) << motion_random(&m) % 8u));
    }
    printf("least work: %.2Le of Fc times the way\n", least);
    TEST_ASSERT_TRUE(least >= -(long double)DAHL_ENERGY_ERROR && least < -1e-11L);
}

/* Words carry: 2^31 counts a tick pass 2^32 with the second tick; sums that are set near the end of a word go on. */
static void test_sums_carry(void)
{
    dahl_params_t p = params_for(1e-3, 0.5f);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    dahl_work_t sums = {{UINT32_MAX, UINT32_MAX, 5}, {UINT32_MAX, UINT32_MAX, UINT32_MAX, 7}};
    dahl_set_torque(&plan, &state, -p.Fc);
    (void)dahl_work_step_counts(&plan, &state, &sums, INT32_MIN);
    TEST_ASSERT_EQUAL_UINT32(0x7fffffffu, sums.counts[0]);
    TEST_ASSERT_EQUAL_UINT32(0, sums.counts[1]);
    TEST_ASSERT_EQUAL_UINT32(6, sums.counts[2]);
    (void)dahl_work_step_counts(&plan, &state, &sums, 1);
    TEST_ASSERT_EQUAL_UINT32(0, sums.way[2]);
    TEST_ASSERT_EQUAL_UINT32(8, sums.way[3]);
    dahl_work_t full = {{UINT32_MAX, UINT32_MAX, UINT32_MAX}, {0}}; /* after 2^65 ticks: around, and nothing beside it */
    (void)dahl_work_step_counts(&plan, &state, &full, 1);
    TEST_ASSERT_TRUE(full.counts[0] == 0 && full.counts[1] == 0 && full.counts[2] == 0);
}

/* With F at Fc all along the bristle keeps nothing of it; and what no float holds, either way. */
static void test_Fc_times_the_way(void)
{
    const struct {
        dahl_params_t p;
        dahl_work_t sums;
        float work;
    } cases[] = {{{0x1p-30f, 1.0f, 0x1p-30f}, {{0}, {0}}, 0.0f},
                 {{0x1p-30f, 1.0f, 0x1p-30f}, {{1}, {0}}, 0x1p-30f},
                 {{1.0f, 0x1p63f, 0x1p63f}, {{3}, {0}}, 0x1.8p127f},
                 {{1e18f, 1e18f, 1e18f}, {{0, 0, 1}, {0}}, HUGE_VALF},
                 {{1e-19f, 1e-19f, 6e-20f}, {{1}, {0}}, 0.0f}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        TEST_ASSERT_TRUE(dahl_work(&cases[i].p, &cases[i].sums) == cases[i].work);
    }
}

/* A spring far below the floats gives back what no float holds; a way far below the counts takes nothing off the work. */
static void test_one_side_far_below_the_other(void)
{
    dahl_params_t small = {1.0f, 0x1p-64f, 0x1p-64f}, fast = {0x1p19f, 1.0f, 1.0f};
    dahl_plan_t plan = plan_for(&small);
    dahl_state_t state = {0};
    dahl_work_t sums = {{0}, {0}};
    dahl_set_torque(&plan, &state, small.Fc);
    (void)dahl_work_step_counts(&plan, &state, &sums, -1);
    TEST_ASSERT_TRUE(dahl_work(&small, &sums) == 0.0f && !signbit(dahl_work(&small, &sums)));

    dahl_work_t slid = {{0}, {0}};
    plan = plan_for(&fast);
    dahl_set_torque(&plan, &state, nextafterf(fast.Fc, 0));
    (void)dahl_work_step_counts(&plan, &state, &slid, INT32_MAX);
    TEST_ASSERT_TRUE(slid.way[0] != 0 || slid.way[1] != 0);
    TEST_ASSERT_TRUE(dahl_work(&fast, &slid) == 0x1p31f);
}

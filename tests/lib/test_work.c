/* SPDX-License-Identifier: MIT */
/* dahl_work against the integral of the exact torque in long double, its passivity, and the ends of its sums. */
#include <stdio.h>

#include "dahl_parts.h"
#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 1000000
#endif

static const double travels[] = {1e-8, 1e-4, 1e-2, 0.3, 20.0};
#define TRAVELS (sizeof travels / sizeof travels[0])

/* The integral of F = Fc (s - (s - w) exp(-a x)) over one stroke from w. */
static long double stroke_work(const dahl_params_t *p, long double w, int32_t dcounts)
{
    long double a = (long double)p->sigma0 / p->Fc, x = fabsl((long double)dcounts) * p->theta_per_count;
    int s = dcounts < 0 ? -1 : 1;
    return p->Fc * (x + s * (s - w) * expm1l(-a * x) / a);
}

/* The bound of dahl_parts.h: relative to the result, and a part for each reversal. */
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
    dahl_set_torque(&plan, &state, 0.875f * p->Fc); /* with energy to return */
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
        if ((t & (t - 1)) == 0 || t == ticks - 1) {
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

/* The least work above -F^2/(2 sigma0) of the start, as a fraction of Fc times the travel. */
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

/* From rest and with stored energy. The rounding does make a little energy. */
static void test_the_bearing_returns_no_more_energy_than_it_stored(void)
{
    motion_t m = MOTION_START;
    long double least = 0;
    for (int k = 0; k < (TEST_TICKS < 100000 ? 100 : TEST_TICKS / 1000); k++) {
        const dahl_params_t p = params_for(pow(2.0, motion_random(&m) * 0x1p-32 * 20 - 29.9), 0.7f);
        const float start = k % 2 ? 0.0f : p.Fc * (float)(int32_t)motion_random(&m) * 0x1p-31f * 0x1p-9f;
        least = fminl(least, least_work(&p, start, &m, UINT32_C(1) << motion_random(&m) % 8u));
    }
    printf("least work: %.2Le of Fc times the way\n", least);
    TEST_ASSERT_TRUE(least >= -1e-9L && least < -1e-11L);
}

static void test_sums_carry_into_the_next_word(void)
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
    dahl_work_t full = {{UINT32_MAX, UINT32_MAX, UINT32_MAX}, {0}}; /* after 2^65 ticks the counts wrap */
    (void)dahl_work_step_counts(&plan, &state, &full, 1);
    TEST_ASSERT_TRUE(full.counts[0] == 0 && full.counts[1] == 0 && full.counts[2] == 0);
}

/* Also results beyond the range of a float at both ends. */
static void test_the_work_of_slip_is_Fc_times_the_travel(void)
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

/* The returned energy, or the part that the bristle keeps, is below the resolution of a float. */
static void test_terms_below_the_resolution_are_dropped(void)
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

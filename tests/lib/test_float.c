/* SPDX-License-Identifier: MIT */
/* The literal float form: its bound on every hard motion, its properties, and the ends of its travel. */
#include <float.h>
#include <stdbool.h>
#include <stdio.h>

#include "dahl_float.h"
#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif

static dahl_float_plan_t float_plan_for(const dahl_params_t *p)
{
    dahl_float_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_float_prepare(&plan, p));
    return plan;
}

typedef struct {
    dahl_params_t params;
    motion_fn next;
    int ticks;
    bool by_angle;
} run_t;

/* The bound is E, plus E for each reversal, which decays as the bristle does. Return the worst used fraction. */
static long double worst_of_bound(const run_t *run)
{
    const dahl_params_t *p = &run->params;
    dahl_float_plan_t plan = float_plan_for(p);
    dahl_float_state_t state = {0};
    reference_t exact = run->by_angle ? reference_by_angle(p) : reference_by_counts(p);
    motion_t m = MOTION_START;
    long double worst = 0, remembered = 0;
    int32_t last = 0;
    for (int t = 0; t < run->ticks; t++) {
        int32_t d = run->next(&m);
        float dtheta = (float)d * p->theta_per_count;
        long double move = run->by_angle ? (long double)dtheta : (long double)d;
        float F = run->by_angle ? dahl_float_step(&plan, &state, dtheta) : dahl_float_step_counts(&plan, &state, d);
        long double error = fabsl(F / p->Fc - reference_move(&exact, move));
        const bool is_reversal = d != 0 && (d > 0) != (last > 0);
        last = d != 0 ? d : last;
        remembered = (remembered + is_reversal) * expl(-exact.a * fabsl(move));
        error /= (long double)DAHL_FLOAT_ERROR * (1 + remembered);
        worst = error > worst ? error : worst;
    }
    return worst;
}

static void test_the_error_stays_within_its_bound(void)
{
    long double over_all = 0;
    for (size_t k = 0; k < MOTIONS; k++) {
        for (double u = 1e-8; u < 30; u *= 10) {
            run_t counts = {params_for(u, u < 1e-4 ? 1.0f : 2.739f), motions[k].next, TEST_TICKS, false};
            run_t angle = {counts.params, counts.next, TEST_TICKS / 10, true};
            long double worst = fmaxl(worst_of_bound(&counts), worst_of_bound(&angle));
            TEST_ASSERT_TRUE_MESSAGE(worst <= 1, motions[k].name);
            over_all = fmaxl(worst, over_all);
        }
    }
    printf("float form: worst %.2Lf of its bound\n", over_all);
    TEST_ASSERT_TRUE(over_all > 0.3L);
}

static void test_any_bits_are_a_safe_state(void)
{
    static const float any[] = {NAN, INFINITY, -INFINITY, 7.0f, -1.0001f, 0.5f};
    static const int32_t directions[] = {0, 5, INT32_MIN};
    static const float clamped[] = {0, 1, -1, 1, -1, 0.5f};
    const dahl_params_t p = params_for(0.02, 1.3f);
    const dahl_float_plan_t plan = float_plan_for(&p);
    for (int k = 0; k < 6; k++) {
        dahl_float_state_t at_rest = {any[k], 0, 0, 0};
        TEST_ASSERT_TRUE(dahl_float_step_counts(&plan, &at_rest, 0) == clamped[k] * p.Fc);
    }
    for (int k = 0; k < 36; k++) {
        dahl_float_state_t state = {any[k % 6], k % 5 == 0 ? UINT32_MAX : 7, k % 7 == 0 ? UINT64_MAX : 7, directions[k % 3]};
        const float F = k < 18 ? dahl_float_step_counts(&plan, &state, 0) : dahl_float_step(&plan, &state, 0.0f);
        const dahl_float_state_t kept = state;
        TEST_ASSERT_TRUE(F >= -p.Fc && F <= p.Fc);
        TEST_ASSERT_TRUE(dahl_float_step_counts(&plan, &state, 0) == F && dahl_float_step(&plan, &state, NAN) == F);
        TEST_ASSERT_EQUAL_MEMORY(&kept, &state, sizeof kept);
        TEST_ASSERT_TRUE(dahl_float_step_counts(&plan, &state, 1000) >= F);
        TEST_ASSERT_TRUE(dahl_float_step(&plan, &state, -HUGE_VALF) == -p.Fc);
    }
}

/* Equal steps, uneven steps, and small steps after one that would absorb them in a float sum. */
static void test_no_error_accumulates_without_a_reversal(void)
{
    static const float sizes[] = {1e-3f, 1e-6f, 1e-8f};
    const dahl_params_t p = {123.4f, 0.7f, 0.0f};
    dahl_float_plan_t plan = float_plan_for(&p);
    for (size_t k = 0; k < 9; k++) {
        const float step = sizes[k / 3] * p.Fc / p.sigma0;
        dahl_float_state_t state = {0};
        reference_t exact = reference_by_angle(&p);
        motion_t m = MOTION_START;
        for (int t = 0; t < 10 * TEST_TICKS; t++) {
            const float uneven = -step * (float)(motion_random(&m) >> 8) * 0x1.3p-24f;
            const float dtheta = k % 3 == 0 ? step : k % 3 == 1 ? uneven : t == 0 ? 0.0047f : step;
            const float F = dahl_float_step(&plan, &state, dtheta);
            TEST_ASSERT_TRUE(fabsl(F / p.Fc - reference_move(&exact, (long double)dtheta)) <= (long double)DAHL_FLOAT_ERROR);
        }
    }
}

/* The travel may exceed its float, the counts may exceed 32 bits: then the torque becomes a new start, and not before. */
static void test_travel_beyond_its_number_starts_anew(void)
{
    dahl_params_t p = {0x1p-64f, 0x1.fp63f, 0.0f}, slow = {1.0f, 1.0f, 0x1p-30f};
    dahl_float_plan_t plan = float_plan_for(&p), slow_plan = float_plan_for(&slow);
    dahl_float_state_t by_angle = {0}, counted = {0}, by_counts = {0.25f, UINT32_MAX - 5u, 0, 1};
    for (int t = 0; t < 100; t++) {
        double F = (double)(dahl_float_step(&plan, &by_angle, FLT_MAX) / p.Fc);
        TEST_ASSERT_TRUE(fabs(F + expm1(-(t + 1) * ((double)FLT_MAX * (double)p.sigma0 / (double)p.Fc))) <= DAHL_FLOAT_ERROR);
        TEST_ASSERT_TRUE(by_angle.w_reversal == 0.0f);
    }
    TEST_ASSERT_TRUE(dahl_float_step(&plan, &by_angle, HUGE_VALF) == p.Fc && dahl_float_step(&plan, &by_angle, 1.0f) == p.Fc);
    for (int t = 1; t <= 16; t++) {
        double F = (double)dahl_float_step_counts(&slow_plan, &counted, INT32_MIN);
        TEST_ASSERT_TRUE(fabs(F - expm1(-2.0 * t)) <= 3 * DAHL_FLOAT_ERROR);
    }
    (void)dahl_float_step_counts(&slow_plan, &by_counts, 5);
    TEST_ASSERT_TRUE(by_counts.counts == UINT32_MAX && by_counts.w_reversal == 0.25f);
    (void)dahl_float_step_counts(&slow_plan, &by_counts, 1);
    TEST_ASSERT_TRUE(by_counts.counts == 1 && by_counts.w_reversal > 0.25f);
}

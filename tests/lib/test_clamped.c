/* SPDX-License-Identifier: MIT */
/* Friction under a load that leaves the stiffness: the promise of dahl_parts.h, the laws, and loads at the ends of their range. */
#include <stdio.h>
#include <string.h>

#include "dahl_parts.h"
#include "loads.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif

/* The exact w = F/Fc: anchored at the last reversal or change of load, whose end is c and whose travel is a/c. */
typedef struct {
    long double a, w_anchor, travel, c;
    int direction;
} exact_t;

static long double exact_w(const exact_t *r)
{
    return r->direction == 0 || r->c == 0 ? r->w_anchor
                                          : r->w_anchor - (r->direction * r->c - r->w_anchor) * expm1l(-r->a / r->c * r->travel);
}

static long double exact_move(exact_t *r, long double move, uint32_t load)
{
    int direction = (move > 0) - (move < 0);
    long double c = load * 0x1p-30L;
    if (c != r->c || (direction != 0 && direction != r->direction)) {
        long double w = c == 0 ? 0 : exact_w(r);
        r->w_anchor = fmaxl(-c, fminl(c, w));
        r->travel = 0;
        r->direction = direction != 0 ? direction : r->direction;
        r->c = c;
    }
    r->travel += fabsl(move);
    return c == 0 ? 0 : exact_w(r);
}

/* In ulp of Fc, or of c Fc where that is more. */
static long double worst_error(const dahl_params_t *p, motion_fn next, load_fn next_load, int ticks)
{
    dahl_plan_t plan = plan_for(p);
    dahl_state_t state = {0};
    exact_t exact = {(long double)p->sigma0 / p->Fc, 0, 0, 0, 0};
    motion_t motion = MOTION_START, loading = MOTION_START;
    long double worst = 0;
    for (int t = 0; t < ticks; t++) {
        float dtheta = (float)next(&motion) * p->theta_per_count;
        uint32_t load = next_load(&loading);
        long double F = exact_move(&exact, dtheta, load) * p->Fc;
        float most = (float)(p->Fc * (double)(load > ONE ? load : ONE) * 0x1p-30);
        worst = fmaxl(worst, fabsl(dahl_clamped_step(&plan, &state, dtheta, load) - F) / ulp_of(most));
    }
    return worst;
}

static void test_hard_motions(void)
{
    static const double travels[] = {1e-8, 1e-6, 1e-4, 1e-2, 0.3, 3.0, 20.0};
    long double over_all = 0;
    for (size_t i = 0; i < 7 * MOTIONS; i++) {
        size_t m = i % MOTIONS, l = (i + i / MOTIONS) % LOADS;
        dahl_params_t p = params_for(travels[i / MOTIONS], i % 2 ? 3.99f : 0.0371f);
        long double worst = worst_error(&p, motions[m].next, loads[l].next, TEST_TICKS);
        printf("clamped %-8s load %-7s travel %.0e  worst %.4Lf ulp\n", motions[m].name, loads[l].name, travels[i / MOTIONS], worst);
        TEST_ASSERT_TRUE_MESSAGE(worst <= (long double)DAHL_ULP_ANGLE, motions[m].name);
        over_all = fmaxl(over_all, worst);
    }
    TEST_ASSERT_TRUE(over_all > 0.49L);
}

/* At a load of 1 it is dahl_step, bit for bit, for any float. */
static void test_load_of_one(void)
{
    dahl_params_t p = params_for(0.01, 1.7f);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0}, plain = {0};
    motion_t m = MOTION_START;
    for (int t = 0; t < 300000; t++) {
        uint32_t bits = motion_random(&m);
        float any, dtheta = (float)motion_leap(&m) * THETA * 1e-6f;
        memcpy(&any, &bits, sizeof any);
        dtheta = t % 3 != 0 ? dtheta : any;
        TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, dtheta, ONE) == dahl_step(&plan, &plain, dtheta));
        TEST_ASSERT_TRUE(state.w == plain.w);
    }
}

/* Without motion: a load that falls cuts F off, one that grows leaves it, and the stiffness is the same under each. */
static void test_load_alone(void)
{
    dahl_params_t p = {100.0f, 2.0f, 1e-3f};
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, 100.0f, ONE) == 2.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, 0.0f, ONE / 2 * 3) == 2.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, 0.0f, ONE / 4) == 0.5f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, -0.0f, ONE) == 0.5f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, -1e30f, ONE / 2) == -1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, 0.0f, ONE / 8) == -0.25f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, 5.0f, 0) == 0.0f && state.w == 0);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, 0.0f, ONE) == 0.0f);
    for (uint32_t load = ONE / 16; load < 2 * ONE - ONE / 16; load += ONE / 16) {
        state.w = 0;
        TEST_ASSERT_FLOAT_WITHIN(1e-12f, 1e-7f, dahl_clamped_step(&plan, &state, 1e-9f, load));
    }
}

/* More than the range is the most of it; what is no number moves nothing, infinity saturates. */
static void test_ends_of_the_input(void)
{
    dahl_params_t p = params_for(0.01, 2.0f), soft = {0x1p-64f, 0x1p63f, 0.0f};
    dahl_plan_t plan = plan_for(&p), soft_plan = plan_for(&soft);
    dahl_state_t state = {0}, most = {0}, little = {1};
    for (int t = 0; t < 999; t++) {
        float dtheta = (float)(t % 7 - 2) * THETA, F = dahl_clamped_step(&plan, &most, dtheta, 0x7fffffffu);
        TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, dtheta, 0x80000000u + (uint32_t)t) == F);
    }
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, INFINITY, ONE / 2) == 1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, -INFINITY, ONE / 2) == -1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, NAN, ONE / 2) == -1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, 1e-45f, ONE / 2) == -1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, INFINITY, 0) == 0.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&soft_plan, &state, -INFINITY, ONE) == -soft.Fc); /* the largest float would not do */
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &little, 0.0f, 0) == 0.0f && little.w == 0);
}

/* Any word as a state, with any plan: no undefined behaviour, and the torque stays below that of the load. */
static void test_any_word_as_a_state(void)
{
    static const dahl_plan_t zero;
    dahl_params_t p = params_for(0.3, 1.0f);
    dahl_plan_t plan = plan_for(&p);
    motion_t m = MOTION_START;
    for (int t = 0; t < 100000; t++) {
        int64_t w = (int64_t)((uint64_t)motion_random(&m) << 32 | motion_random(&m));
        dahl_state_t state = {w}, still = {w};
        uint32_t load = load_any(&m);
        float F = dahl_clamped_step(&plan, &state, (float)motion_walk(&m) * THETA, load);
        TEST_ASSERT_TRUE(fabsf(F) <= (float)((load + 1) * 0x1p-30) * 1.0000001f);
        TEST_ASSERT_TRUE(dahl_clamped_step(&zero, &still, 1.0f, load) == 0.0f && still.w == w);
    }
}

/* Each change of load and each move gives up energy, so every closed cycle of both does: the stored F^2/(2 sigma0) never grows by
 * more than the work of the shaft, c Fc |dtheta| - s (c Fc/sigma0) (F after - F before). */
static void test_passive(void)
{
    dahl_params_t p = params_for(0.05, 1.0f);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    motion_t m = MOTION_START;
    long double before = 0, unit = (long double)p.Fc * p.Fc / p.sigma0;
    for (int t = 0; t < 300000; t++) {
        uint32_t load = load_any(&m) | 1;
        long double c = load * 0x1p-30L, F = dahl_clamped_step(&plan, &state, 0.0f, load);
        TEST_ASSERT_TRUE(F * F <= before * before * (1 + 1e-15L));
        float dtheta = (float)motion_walk(&m) * THETA;
        long double after = dahl_clamped_step(&plan, &state, dtheta, load);
        long double work = c * p.Fc * (fabsl(dtheta) - (dtheta < 0 ? -1 : 1) * (after - F) / p.sigma0);
        TEST_ASSERT_TRUE(work >= (after * after - F * F) / (2 * p.sigma0) - 1e-6L * unit);
        before = after;
    }
}

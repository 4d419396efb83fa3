/* SPDX-License-Identifier: MIT */
/* Friction under a load that changes: the promise of dahl_parts.h, the laws, and loads at the ends of their range. */
#include <stdio.h>
#include <stdlib.h>

#include "dahl_parts.h"
#include "loads.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif

/* The exact w = F/(c Fc): anchored at the last reversal or growth of the load. */
typedef struct {
    reference_t bristle;
    uint32_t load;
} exact_t;

static long double exact_move(exact_t *r, int32_t counts, uint32_t load)
{
    if (load > r->load) {
        r->bristle.w_reversal = reference_w(&r->bristle) * r->load / load;
        r->bristle.travel = 0;
    }
    r->load = load;
    return reference_move(&r->bristle, counts);
}

/* Worst error of the torque in ulp of c Fc, and of the Q30 result in units. */
static long double worst_error(const dahl_params_t *p, motion_fn next, load_fn next_load, int ticks, long double *q30)
{
    dahl_plan_t plan = plan_for(p);
    dahl_loaded_state_t state = {{0}, 0}, other = {{0}, 0};
    exact_t exact = {reference_by_counts(p), 0};
    motion_t motion = MOTION_START, loading = MOTION_START;
    long double worst = 0;
    *q30 = 0;
    for (int t = 0; t < ticks; t++) {
        int32_t d = next(&motion);
        uint32_t load = next_load(&loading);
        long double w = exact_move(&exact, d, load), F = w * p->Fc * load * 0x1p-30L;
        long double error = fabsl(dahl_loaded_step_counts(&plan, &state, d, load) - F);
        worst = fmaxl(worst, error / ulp_of((float)(p->Fc * (double)(load > 0 ? load : 1) * 0x1p-30)));
        *q30 = fmaxl(*q30, fabsl(dahl_loaded_step_counts_q30(&plan, &other, d, load) - w * load));
    }
    TEST_ASSERT_TRUE(state.bristle.w == other.bristle.w);
    return worst;
}

static void test_hard_motions(void)
{
    static const double travels[] = {1e-9, 1e-6, 1e-4, 1e-2, 0.3, 3.0, 20.0};
    long double over_all = 0;
    for (size_t i = 0; i < 7 * MOTIONS; i++) {
        size_t m = i % MOTIONS, l = (i + i / MOTIONS) % LOADS;
        dahl_params_t p = params_for(travels[i / MOTIONS], i % 2 ? 3.99f : 0.0371f);
        long double q30, worst = worst_error(&p, motions[m].next, loads[l].next, TEST_TICKS, &q30);
        printf("loaded %-8s load %-7s travel %.0e  worst %.4Lf ulp of c Fc, %.2Lf units\n", motions[m].name, loads[l].name,
               travels[i / MOTIONS], worst, q30);
        TEST_ASSERT_TRUE_MESSAGE(worst <= DAHL_ULP_PARTS, motions[m].name);
        TEST_ASSERT_TRUE_MESSAGE(q30 * DAHL_Q30 <= DAHL_LOADED_ERROR_Q30, motions[m].name);
        TEST_ASSERT_TRUE_MESSAGE(q30 * DAHL_Q30 <= 1.85e-9 || loads[l].most > 1u << 30, motions[m].name);
        over_all = fmaxl(over_all, worst);
    }
    TEST_ASSERT_TRUE(over_all > 0.49L);
}

/* At a load of 1 it is dahl_step_counts, bit for bit; at half of it half the torque, exactly. */
static void test_load_of_one(void)
{
    dahl_params_t p = params_for(0.01, 1.7f);
    dahl_plan_t plan = plan_for(&p);
    dahl_loaded_state_t state = {{0}, 0}, half = {{0}, 0}, q30 = {{0}, 0};
    dahl_state_t plain = {0}, plain_q30 = {0};
    motion_t m = MOTION_START;
    for (int t = 0; t < 100000; t++) {
        int32_t d = motion_leap(&m) >> (t % 20);
        float F = dahl_step_counts(&plan, &plain, d);
        TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &state, d, ONE) == F);
        TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &half, d, ONE / 2) == F / 2);
        int32_t q = dahl_step_counts_q30(&plan, &plain_q30, d);
        int32_t rounded = (int32_t)(((int64_t)q + 1 + ((int64_t)1 << 31)) / 2 - ((int64_t)1 << 30)); /* q/2, a half up */
        TEST_ASSERT_EQUAL_INT32(rounded, dahl_loaded_step_counts_q30(&plan, &q30, d, ONE / 2));
    }
}

/* Without motion: F falls with the load, is kept when it grows, and is gone once there was none. */
static void test_load_alone(void)
{
    dahl_params_t p = params_for(0.01, 2.0f);
    dahl_plan_t plan = plan_for(&p);
    dahl_loaded_state_t state = {{0}, 0};
    TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &state, INT32_MAX, ONE) == 2.0f);
    TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &state, 0, ONE / 4) == 0.5f);
    TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &state, 0, ONE / 2) == 0.5f);
    TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &state, 0, ONE / 2 * 3) == 0.5f);
    TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &state, 0, ONE / 4 * 3) == 0.25f);
    TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &state, 0, 0) == 0.0f);
    TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &state, 0, ONE) == 0.0f && state.bristle.w == 0);
    TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &state, INT32_MIN, 0) == 0.0f);
}

/* No load is refused: more than the range is the most of it. */
static void test_load_above_its_range(void)
{
    static const uint32_t above[] = {0x80000000u, 0x80000001u, 0xffffffffu};
    dahl_params_t p = params_for(0.01, 2.0f);
    dahl_plan_t plan = plan_for(&p);
    dahl_loaded_state_t most = {{0}, 0}, state = {{0}, 0};
    for (int t = 0; t < 999; t++) {
        float F = dahl_loaded_step_counts(&plan, &most, 1 - t % 2 * 3, 0x7fffffffu);
        TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &state, 1 - t % 2 * 3, above[t % 3]) == F);
    }
    (void)dahl_loaded_step_counts_q30(&plan, &state, INT32_MAX, 0xffffffffu);
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, dahl_loaded_step_counts_q30(&plan, &state, 1, 0xffffffffu));
    TEST_ASSERT_EQUAL_INT32(-INT32_MAX, dahl_loaded_step_counts_q30(&plan, &state, INT32_MIN, 0xffffffffu));
}

/* Torques that no normal float holds are 0, and no load or plan makes one of the others wrong. */
static void test_least_torques(void)
{
    dahl_params_t p = {0x1p-60f, 0x1p-64f, 0x1p-10f};
    dahl_plan_t plan = plan_for(&p);
    motion_t m = MOTION_START;
    for (int i = 0; i < 100000; i++) {
        uint32_t load = (motion_random(&m) >> (motion_random(&m) % 32u) >> 1) | 1;
        dahl_loaded_state_t state = {{(int64_t)(motion_random(&m) | 1) << 30 >> (motion_random(&m) % 62u)}, load};
        long double c_Fc = p.Fc * (load * 0x1p-30L), F = ldexpl(state.bristle.w, -62) * c_Fc;
        float got = dahl_loaded_step_counts(&plan, &state, 0, load);
        TEST_ASSERT_TRUE(fabsl(got - F) <= 0.512L * c_Fc * 0x1p-23L && (got == 0.0f || got >= 0x1p-126f));
        dahl_loaded_state_t mirrored = {{-state.bristle.w}, load};
        TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &mirrored, 0, load) == -got);
        TEST_ASSERT_TRUE(F >= 0x1p-126L * 0x1p32L ? fabsl(got - F) <= 0x1p-24L * 1.02L * F : 1);
    }
}

static void test_a_plan_of_zeros(void)
{
    static const dahl_plan_t zero;
    dahl_loaded_state_t state = {{12345}, ONE};
    TEST_ASSERT_TRUE(dahl_loaded_step_counts(&zero, &state, 7, ONE) == 0.0f && state.bristle.w == 12345);
    TEST_ASSERT_TRUE(dahl_loaded_step_counts(&zero, &state, INT32_MIN, ONE / 3) == 0.0f);
    TEST_ASSERT_TRUE(dahl_loaded_step_counts(&zero, &state, 1, 0xffffffffu) == 0.0f);
}

/* Work of the shaft never falls short of what the bristle holds, F^2/(2 c sigma0): each move and each change of load alone gives up
 * energy, so every closed cycle of both does. Of a move the work is Fc |dtheta| - s (Fc/sigma0) (F after - F before). */
static void test_passive(void)
{
    dahl_params_t p = params_for(0.05, 1.0f);
    dahl_plan_t plan = plan_for(&p);
    dahl_loaded_state_t state = {{0}, 0};
    motion_t m = MOTION_START;
    long double energy = 0, unit = (long double)p.Fc * p.Fc / p.sigma0;
    for (int t = 0; t < 300000; t++) {
        uint32_t load = load_any(&m) | 1;
        long double c = load * 0x1p-30L, F = dahl_loaded_step_counts(&plan, &state, 0, load), w = state.bristle.w * 0x1p-62L;
        TEST_ASSERT_TRUE(c * w * w / 2 * unit <= energy * (1 + 1e-15L));
        int32_t d = motion_walk(&m);
        long double after = dahl_loaded_step_counts(&plan, &state, d, load);
        long double work = c * p.Fc * abs(d) * THETA - (d < 0 ? -1 : 1) * p.Fc / (long double)p.sigma0 * (after - F);
        w = state.bristle.w * 0x1p-62L;
        TEST_ASSERT_TRUE(work >= c * w * w / 2 * unit - energy - 1e-7L * c * unit);
        energy = c * w * w / 2 * unit;
    }
}

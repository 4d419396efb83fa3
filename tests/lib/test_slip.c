/* SPDX-License-Identifier: MIT */
/* Slip elements: their laws bit for bit, any parameters, and the ends of the format. What they share with every model is tested in
 * test_accuracy.c, test_laws.c and test_params.c. */
#include <stdio.h>
#include <unity.h>

#include "models.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif

#define LAW_TICKS (TEST_TICKS < 20000 ? TEST_TICKS : 20000)
#define PLANS (TEST_TICKS < 20000 ? 300 : 20000)

static dahl_slip_plan_t plan_of(const dahl_slip_params_t *params)
{
    dahl_slip_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_slip_prepare(&plan, params));
    return plan;
}

/* Within the bound on leaps, and then all elements slip: +-2^30, and the float nearest to the sum of Fc where that is one. Returns
 * the worst error in ulp of that sum. */
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
    (void)dahl_slip_step_counts_q30(&plan, &q30, INT32_MAX); /* 2^31 counts may lie between both ends */
    (void)dahl_slip_step_counts(&plan, &state, INT32_MAX);
    TEST_ASSERT_EQUAL_INT32(1 << 30, dahl_slip_step_counts_q30(&plan, &q30, INT32_MAX));
    TEST_ASSERT_EQUAL_INT32(-(1 << 30), dahl_slip_step_counts_q30(&plan, &q30, INT32_MIN));
    TEST_ASSERT_TRUE((float)Fc != Fc || dahl_slip_step_counts(&plan, &state, INT32_MAX) == (float)Fc);
    return worst;
}

/* 1 <= x < 2 */
static float random_mantissa(motion_t *m)
{
    return 1.0f + (float)(motion_random(m) >> 9) * 0x1p-23f;
}

/* Travel of a count from 2^-28 to 2^8, Fc within 2^(spread of exponents) of each other. */
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

static void test_any_parameters(void)
{
    motion_t m = MOTION_START;
    long double worst = 0;
    for (int i = 0; i < PLANS; i++) {
        const dahl_slip_params_t params = random_params(&m);
        worst = fmaxl(worst, check_leaps(&params, &m, 50));
    }
    printf("any parameters: worst %.4Lf ulp of the sum of Fc\n", worst);
    TEST_ASSERT_TRUE(worst > 0.49L);
}

/* Ways to slipping that are powers of two, or just below one, and shares of all and of nearly nothing; a sum of Fc that takes more
 * than 32 bits, all of them ones. */
static void test_ends_of_the_format(void)
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
    dahl_slip_state_t state = {{0}};
    TEST_ASSERT_TRUE(dahl_slip_step_counts(&plan, &state, 1000) == 2.0f && dahl_slip_step_counts(&plan, &state, -1000) == -2.0f);
    /* 1/u = 1 - 2^-46 counts: as good as one, and not beyond it */
    const dahl_slip_params_t one = {1, 0x1.000002p0f, {0x1.000002p0f}, {0x1.000004p0f}};
    const dahl_slip_state_t rest = {{0}};
    plan = plan_of(&one);
    state = rest;
    TEST_ASSERT_TRUE(dahl_slip_step_counts(&plan, &state, 1) == one.Fc[0]);
    TEST_ASSERT_TRUE(fabsf(dahl_slip_step_counts(&plan, &state, -1)) <= 0x1p-29f);
}

static dahl_slip_params_t four_elements(void)
{
    dahl_slip_params_t params = {4, 3.8e-4f, {900.0f, 170.0f, 21.0f, 3.1f}, {0.4f, 0.7f, 0.35f, 0.9f}};
    return params;
}

/* A loop inside the range of the last one leaves no trace: back at its start all is as it was, bit for bit; and loops in it. */
static void closed_loop(const dahl_slip_plan_t *plan, dahl_slip_state_t *state, int32_t size, int32_t s, motion_t *m)
{
    const dahl_slip_state_t tip = *state;
    int32_t way = (int32_t)(motion_random(m) % (uint32_t)size) + 1;
    (void)dahl_slip_step_counts(plan, state, -s * way);
    if (way > 2) {
        closed_loop(plan, state, way - 1, -s, m);
    }
    (void)dahl_slip_step_counts(plan, state, s * way);
    TEST_ASSERT_EQUAL_MEMORY(&tip, state, sizeof tip);
}

static void test_return_point_memory(void)
{
    const dahl_slip_params_t params = four_elements();
    const dahl_slip_plan_t plan = plan_of(&params);
    motion_t m = MOTION_START;
    for (int t = 0; t < LAW_TICKS; t++) {
        dahl_slip_state_t state = {{0}};
        int32_t size = (int32_t)(motion_random(&m) % 2000u) + 2, s = t % 2 ? 1 : -1;
        (void)dahl_slip_step_counts(&plan, &state, -s * (int32_t)(motion_random(&m) % 3000u));
        (void)dahl_slip_step_counts(&plan, &state, s * size);
        closed_loop(&plan, &state, size, s, &m);
    }
}

/* Torque of each element in whole units, so that differences are exact. */
static void assert_same_change(const dahl_slip_state_t *a0, const dahl_slip_state_t *a1, const dahl_slip_state_t *b0,
                               const dahl_slip_state_t *b1, int64_t factor)
{
    for (int k = 0; k < 4; k++) {
        TEST_ASSERT_TRUE((int64_t)a1->x[k] - a0->x[k] == factor * ((int64_t)b1->x[k] - b0->x[k]));
    }
}

/* Loops between the same two angles are congruent, whatever led to them. */
static void test_congruency(void)
{
    const dahl_slip_params_t params = four_elements();
    const dahl_slip_plan_t plan = plan_of(&params);
    motion_t m = MOTION_START;
    for (int t = 0; t < LAW_TICKS; t++) {
        dahl_slip_state_t tip[2] = {{{0}}, {{0}}}, now[2];
        int32_t size = (int32_t)(motion_random(&m) % 1000u) + 1, inside = (int32_t)(motion_random(&m) % (uint32_t)size);
        for (int history = 0; history < 2; history++) {
            for (int i = 0; i < 5; i++) {
                (void)dahl_slip_step_counts(&plan, &tip[history], (int32_t)(motion_random(&m) % 4001u) - 2000);
            }
            (void)dahl_slip_step_counts(&plan, &tip[history], size);
            (void)dahl_slip_step_counts(&plan, &tip[history], -size);
            (void)dahl_slip_step_counts(&plan, &tip[history], size);
            now[history] = tip[history];
            (void)dahl_slip_step_counts(&plan, &now[history], -inside);
        }
        assert_same_change(&tip[0], &now[0], &tip[1], &now[1], 1);
    }
}

/* Masing: after a reversal the curve from rest, upside down and twice as large. */
static void test_masing(void)
{
    const dahl_slip_params_t params = four_elements();
    const dahl_slip_plan_t plan = plan_of(&params);
    const dahl_slip_state_t rest = {{0}};
    motion_t m = MOTION_START;
    for (int t = 0; t < LAW_TICKS; t++) {
        int32_t way = (int32_t)(motion_random(&m) % 1000u), size = way + (int32_t)(motion_random(&m) % 1000u);
        dahl_slip_state_t initial = rest, tip = rest, back;
        (void)dahl_slip_step_counts(&plan, &initial, way);
        (void)dahl_slip_step_counts(&plan, &tip, size);
        back = tip;
        (void)dahl_slip_step_counts(&plan, &back, -2 * way);
        assert_same_change(&tip, &back, &rest, &initial, -2);
    }
}

/* Passive: random closed cycles never give energy. Elements that need a count or more to slip dissipate more than the trapezoid of a
 * tick leaves out. */
static void test_no_energy_from_closed_cycles(void)
{
    const dahl_slip_params_t params = {3, 3.8e-4f, {900.0f, 170.0f, 21.0f}, {0.4f, 0.7f, 0.35f}};
    const dahl_slip_plan_t plan = plan_of(&params);
    motion_t m = MOTION_START;
    for (int cycle = 0; cycle < LAW_TICKS / 20; cycle++) {
        dahl_slip_state_t state = {{0}};
        int32_t turns[6], sum = 0;
        double work = 0, F = 0;
        for (int i = 0; i < 5; i++) {
            turns[i] = (int32_t)(motion_random(&m) % 101u) - 50;
            sum += turns[i];
        }
        turns[5] = -sum;
        for (int i = 0; i < 12; i++) { /* once to come to the cycle, and once in it */
            work = i == 6 ? 0 : work;
            const int32_t s = turns[i % 6] < 0 ? -1 : 1;
            for (int32_t n = s * turns[i % 6]; n > 0; n--) {
                double next = (double)dahl_slip_step_counts(&plan, &state, s);
                work += 0.5 * s * (F + next);
                F = next;
            }
        }
        TEST_ASSERT_TRUE(work >= -1e-7 * 600);
    }
}

/* SPDX-License-Identifier: MIT */
/* Slip elements: the guarantee of dahl_parts.h on every hard motion, their laws bit for bit, and bad input. */
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "motions.h"
#include "slip_reference.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif

#define LAW_TICKS (TEST_TICKS < 20000 ? TEST_TICKS : 20000)
#define PLANS (TEST_TICKS < 20000 ? 300 : 20000)
#define ONE_Q30 (INT32_C(1) << 30)

static long double larger(long double a, long double b)
{
    return a > b ? a : b;
}

static dahl_slip_plan_t plan_of(const dahl_slip_params_t *params)
{
    dahl_slip_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_slip_prepare(&plan, params));
    return plan;
}

/* Elements whose ways to slipping are spread over three decades below 1/u counts, and whose shares are not equal. */
static dahl_slip_params_t spread(uint32_t elements, double u, float Fc)
{
    dahl_slip_params_t params = {elements, 3.8e-4f, {0}, {0}};
    for (uint32_t k = 0; k < elements; k++) {
        double travel = u * pow(10.0, 3.0 * k / elements);
        params.Fc[k] = Fc / (float)(k % 3 + 1);
        params.sigma0[k] = (float)(travel * (double)params.Fc[k] / (double)params.theta_per_count);
    }
    return params;
}

/* docs/accuracy.md: error of F / sum of Fc before it is rounded, with K elements. */
static long double bound_of(uint32_t elements)
{
    return 0x1p-30L + (elements - 0.5L) * 0x1p-32L;
}

typedef struct {
    long double torque_ulp;
    long double q30;
} worst_t;

static worst_t run(const dahl_slip_params_t *params, motion_fn next, int ticks)
{
    const dahl_slip_plan_t plan = plan_of(params);
    dahl_slip_state_t by_torque = {{0}}, by_q30 = {{0}};
    slip_reference_t exact = slip_reference(params);
    const long double Fc = slip_reference_Fc(params), ulp = ulp_of_sum(Fc);
    motion_t motion = MOTION_START;
    worst_t worst = {0, 0};
    for (int t = 0; t < ticks; t++) {
        int32_t d = next(&motion);
        long double F = slip_reference_move(&exact, d);
        worst.torque_ulp = larger(worst.torque_ulp, fabsl(dahl_slip_step_counts(&plan, &by_torque, d) - F) / ulp);
        long double ratio = dahl_slip_step_counts_q30(&plan, &by_q30, d) * (long double)DAHL_Q30;
        worst.q30 = larger(worst.q30, fabsl(ratio - F / Fc));
    }
    TEST_ASSERT_EQUAL_MEMORY(&by_torque, &by_q30, sizeof by_q30);
    return worst;
}

static void check_motion(size_t m)
{
    static const double travels[] = {2e-9, 1e-6, 1e-4, 0.03, 0.3};
    long double over_all = 0;
    for (size_t i = 0; i < 5; i++) {
        uint32_t elements = UINT32_C(1) << i % 4;
        dahl_slip_params_t params = spread(elements, travels[i], i % 2 ? 2.739f : 0.0371f);
        worst_t worst = run(&params, motions[m].next, TEST_TICKS);
        printf("%-8s travel/count %.0e K %u  worst %.4Lf ulp of Fc, Q30 %.2Le\n", motions[m].name, travels[i], (unsigned)elements,
               worst.torque_ulp, worst.q30);
        TEST_ASSERT_TRUE_MESSAGE(worst.torque_ulp <= 0.50391L + bound_of(elements) * 0x1p24L, motions[m].name);
        TEST_ASSERT_TRUE_MESSAGE(worst.q30 <= bound_of(elements) + 0x1p-31L, motions[m].name);
        over_all = larger(over_all, worst.torque_ulp);
    }
    TEST_ASSERT_TRUE(over_all > 0.4L); /* half an ulp is the rounding to float: the comparison does compare */
}

static void test_sweep(void) { check_motion(0); }
static void test_dither(void) { check_motion(1); }
static void test_two_forward_one_back(void) { check_motion(2); }
static void test_random_walk(void) { check_motion(3); }
static void test_leaps(void) { check_motion(4); }

static void test_bounds_are_what_is_promised(void)
{
    TEST_ASSERT_TRUE(DAHL_ULP_PARTS <= 0.55 && DAHL_SLIP_ERROR_Q30 <= 3.15e-9);
    TEST_ASSERT_TRUE(0.50391L + bound_of(DAHL_SLIP_MAX) * 0x1p24L <= (long double)DAHL_ULP_PARTS);
    TEST_ASSERT_TRUE(bound_of(DAHL_SLIP_MAX) + 0x1p-31L <= (long double)DAHL_SLIP_ERROR_Q30);
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

/* Any parameters: within the bound on the way, and all elements slipping are +-2^30, and the float nearest to the sum of Fc
 * where that is one. */
static void test_any_parameters(void)
{
    motion_t m = MOTION_START;
    long double worst = 0;
    for (int i = 0; i < PLANS; i++) {
        const dahl_slip_params_t params = random_params(&m);
        const dahl_slip_plan_t plan = plan_of(&params);
        dahl_slip_state_t state = {{0}}, q30;
        slip_reference_t exact = slip_reference(&params);
        const long double Fc = slip_reference_Fc(&params), ulp = ulp_of_sum(Fc);
        for (int t = 0; t < 50; t++) {
            int32_t d = motion_leap(&m) / 4;
            long double error = fabsl(dahl_slip_step_counts(&plan, &state, d) - slip_reference_move(&exact, d)) / ulp;
            worst = larger(worst, error);
        }
        q30 = state;
        TEST_ASSERT_EQUAL_INT32(ONE_Q30, dahl_slip_step_counts_q30(&plan, &q30, INT32_MAX));
        TEST_ASSERT_EQUAL_INT32(-ONE_Q30, dahl_slip_step_counts_q30(&plan, &q30, INT32_MIN));
        if ((float)Fc == Fc) {
            TEST_ASSERT_TRUE(dahl_slip_step_counts(&plan, &state, INT32_MAX) == (float)Fc);
        }
    }
    printf("any parameters: worst %.4Lf ulp of the sum of Fc\n", worst);
    TEST_ASSERT_TRUE(worst <= (long double)DAHL_ULP_PARTS && worst > 0.49L);
}

/* Ways to slipping that are powers of two, or just below one, and shares of all and of nearly nothing. */
static void test_ends_of_the_format(void)
{
    static const float travels[] = {0x1p-30f, 0x1p-29f, 0x1.fffffep-20f, 1.0f, 0x1.000002p0f, 0x1p10f, 0x1.fffffep19f};
    for (size_t i = 0; i < sizeof travels / sizeof travels[0]; i++) {
        for (int k = 0; k <= 60; k += 4) {
            dahl_slip_params_t params = {DAHL_SLIP_MAX, 0x1p-30f, {0x1p30f * travels[i]}, {1.0f}};
            for (int j = 1; j < DAHL_SLIP_MAX; j++) {
                params.Fc[j] = ldexpf(1.75f, -k);
                params.sigma0[j] = params.Fc[j] * 0x1p30f * travels[(i + (size_t)j) % 7];
            }
            worst_t worst = run(&params, motion_leap, 300);
            TEST_ASSERT_TRUE(worst.torque_ulp <= (long double)DAHL_ULP_PARTS && worst.q30 <= (long double)DAHL_SLIP_ERROR_Q30);
        }
    }
    /* 1/u = 1 - 2^-46 counts: as good as one, and not beyond it */
    dahl_slip_params_t params = {1, 0x1.000002p0f, {0x1.000002p0f}, {0x1.000004p0f}};
    const dahl_slip_plan_t plan = plan_of(&params);
    dahl_slip_state_t state = {{0}};
    TEST_ASSERT_TRUE(dahl_slip_step_counts(&plan, &state, 1) == params.Fc[0]);
    TEST_ASSERT_TRUE(fabsf(dahl_slip_step_counts(&plan, &state, -1)) <= 0x1p-29f);
}

/* A sum of Fc that takes more than 32 bits, all of them ones: what slips has the nearest float. */
static void test_a_sum_just_below_a_power_of_two(void)
{
    dahl_slip_params_t params = {2, 0.5f, {1.0f, 0x1p-24f}, {0x1.fffffep0f, 0x1.fffffep-24f}};
    const dahl_slip_plan_t plan = plan_of(&params);
    dahl_slip_state_t state = {{0}};
    TEST_ASSERT_TRUE(dahl_slip_step_counts(&plan, &state, 1000) == 2.0f);
    TEST_ASSERT_TRUE(dahl_slip_step_counts(&plan, &state, -1000) == -2.0f);
    worst_t worst = run(&params, motion_leap, 300);
    TEST_ASSERT_TRUE(worst.torque_ulp <= (long double)DAHL_ULP_PARTS);
}

static dahl_slip_params_t four_elements(void)
{
    dahl_slip_params_t params = {4, 3.8e-4f, {900.0f, 170.0f, 21.0f, 3.1f}, {0.4f, 0.7f, 0.35f, 0.9f}};
    return params;
}

/* However many counts a tick has: the same state, bit for bit. */
static void test_composition_of_travel(void)
{
    const dahl_slip_params_t params = four_elements();
    const dahl_slip_plan_t plan = plan_of(&params);
    dahl_slip_state_t whole = {{0}}, parts = {{0}};
    motion_t m = MOTION_START;
    for (int t = 0; t < LAW_TICKS; t++) {
        int32_t d = (int32_t)(motion_random(&m) % 4001u) - 2000, first = d / 3;
        (void)dahl_slip_step_counts(&plan, &parts, first);
        float F = dahl_slip_step_counts(&plan, &whole, d);
        TEST_ASSERT_TRUE(dahl_slip_step_counts(&plan, &parts, d - first) == F);
        TEST_ASSERT_TRUE(dahl_slip_step_counts(&plan, &parts, 0) == F); /* no motion changes nothing */
        TEST_ASSERT_EQUAL_MEMORY(&whole, &parts, sizeof whole);
    }
}

static void test_odd_symmetry(void)
{
    const dahl_slip_params_t params = four_elements();
    const dahl_slip_plan_t plan = plan_of(&params);
    for (size_t i = 0; i < MOTIONS; i++) {
        dahl_slip_state_t state = {{0}}, mirrored = {{0}}, q30 = {{0}}, q30_mirrored = {{0}};
        motion_t m = MOTION_START;
        for (int t = 0; t < LAW_TICKS; t++) {
            int32_t d = motions[i].next(&m);
            d = d == INT32_MIN ? -INT32_MAX : d;
            TEST_ASSERT_TRUE(dahl_slip_step_counts(&plan, &state, d) == -dahl_slip_step_counts(&plan, &mirrored, -d));
            TEST_ASSERT_EQUAL_INT32(dahl_slip_step_counts_q30(&plan, &q30, d), -dahl_slip_step_counts_q30(&plan, &q30_mirrored, -d));
        }
    }
}

/* Further is never less torque, and never more than sigma0 of all elements allows. */
static void test_monotone_in_travel(void)
{
    const dahl_slip_params_t params = four_elements();
    const dahl_slip_plan_t plan = plan_of(&params);
    const double slope = (double)((900.0f + 170.0f + 21.0f + 3.1f) * 3.8e-4f);
    dahl_slip_state_t state = {{0}};
    motion_t m = MOTION_START;
    for (int t = 0; t < LAW_TICKS; t++) {
        (void)dahl_slip_step_counts(&plan, &state, (int32_t)(motion_random(&m) % 4001u) - 2000);
        dahl_slip_state_t near = state, far = state;
        int32_t d = (int32_t)(motion_random(&m) % 20u);
        double F = (double)dahl_slip_step_counts(&plan, &near, d), G = (double)dahl_slip_step_counts(&plan, &far, d + 1);
        TEST_ASSERT_TRUE(G >= F && G - F <= slope * (1 + 1e-6) + 2e-7);
    }
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

/* The plan is untouched on an error. */
static dahl_err_t try(dahl_slip_params_t params)
{
    dahl_slip_plan_t plan, untouched;
    memset(&plan, 0x5a, sizeof plan);
    memcpy(&untouched, &plan, sizeof plan);
    dahl_err_t err = dahl_slip_prepare(&plan, &params);
    TEST_ASSERT_TRUE(err == DAHL_OK || memcmp(&plan, &untouched, sizeof plan) == 0);
    return err;
}

static void test_bad_parameters(void)
{
    static const float bad[] = {0.0f, -0.0f, -1.0f, -1e-45f, NAN, -NAN, HUGE_VALF, -HUGE_VALF};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        for (int k = 0; k < 4; k++) {
            dahl_slip_params_t sigma0 = four_elements(), Fc = four_elements(), theta = four_elements();
            sigma0.sigma0[k] = Fc.Fc[k] = theta.theta_per_count = bad[i];
            TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(sigma0));
            TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(Fc));
            TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(theta));
        }
    }
    dahl_slip_params_t params = four_elements();
    for (int k = 4; k < DAHL_SLIP_MAX; k++) {
        params.Fc[k] = params.sigma0[k] = NAN; /* not read */
    }
    TEST_ASSERT_EQUAL_INT(DAHL_OK, try(params));
    params.elements = 0;
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(params));
    params.elements = DAHL_SLIP_MAX + 1;
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(params));
    params.elements = UINT32_MAX;
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(params));
}

/* The last element's, in the place where a careless loop would not look. */
static dahl_err_t try_last(float sigma0, float Fc, float theta_per_count)
{
    dahl_slip_params_t params = {DAHL_SLIP_MAX, theta_per_count, {0}, {0}};
    for (int k = 0; k < DAHL_SLIP_MAX; k++) {
        params.Fc[k] = params.sigma0[k] = 1.0f / theta_per_count;
    }
    params.Fc[DAHL_SLIP_MAX - 1] = Fc;
    params.sigma0[DAHL_SLIP_MAX - 1] = sigma0;
    return try(params);
}

static void test_ranges(void)
{
    const float least = DAHL_TORQUE_MIN, below = nextafterf(least, 0.0f), above = DAHL_TORQUE_MAX;
    const float slow = (float)DAHL_TRAVEL_MIN, fast = (float)DAHL_TRAVEL_MAX;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, try_last(least, least, 1.0f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try_last(below, least, 1.0f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try_last(least, below, 1.0f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try_last(above, nextafterf(above, 0.0f), 1.0f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try_last(1.0f, above, 1.0f));
    TEST_ASSERT_EQUAL_INT(DAHL_OK, try_last(slow, 1.0f, 1.0f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try_last(nextafterf(slow, 0.0f), 1.0f, 1.0f));
    TEST_ASSERT_EQUAL_INT(DAHL_OK, try_last(nextafterf(fast, 0.0f), 1.0f, 1.0f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try_last(fast, 1.0f, 1.0f));
}

static void test_a_plan_of_zeros(void)
{
    static const dahl_slip_plan_t zero;
    dahl_slip_state_t state = {{5, -7, INT32_MIN, INT32_MAX}}, before = state;
    for (size_t i = 0; i < MOTIONS; i++) {
        motion_t m = MOTION_START;
        for (int t = 0; t < 100; t++) {
            int32_t d = motions[i].next(&m);
            TEST_ASSERT_TRUE(dahl_slip_step_counts(&zero, &state, d) == 0.0f);
            TEST_ASSERT_EQUAL_INT32(0, dahl_slip_step_counts_q30(&zero, &state, d));
        }
    }
    TEST_ASSERT_EQUAL_MEMORY(&before, &state, sizeof state);
}

/* A state that no call leaves means nothing, but is no undefined behaviour (seen under the sanitizers). */
static void test_any_word_as_a_state(void)
{
    static const int32_t words[] = {INT32_MIN, INT32_MIN + 1, -1, INT32_MAX}, counts[] = {0, 1, -1, INT32_MAX, INT32_MIN};
    const dahl_slip_params_t params = four_elements();
    const dahl_slip_plan_t plan = plan_of(&params);
    for (size_t i = 0; i < 20; i++) {
        int32_t word = words[i % 4];
        dahl_slip_state_t state = {{word, word, word, word}};
        (void)dahl_slip_step_counts(&plan, &state, counts[i / 4]);
        TEST_ASSERT_EQUAL_INT32(ONE_Q30, dahl_slip_step_counts_q30(&plan, &state, INT32_MAX));
    }
}

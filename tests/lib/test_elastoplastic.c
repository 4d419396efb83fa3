/* SPDX-License-Identifier: MIT */
/* The elasto-plastic element: the promise of dahl_parts.h, the laws, and what prepare refuses. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dahl_parts.h"
#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif

/*
 * The exact w, event by event, in long double. Elastic: w = from + counts u, the counts since it became elastic added exactly.
 * Plastic, in direction s: the gap to s is (1 - b) exp(-kappa u) of the travel since breakaway, or what was left of it.
 */
typedef struct {
    long double u, b;
    long double from;   /* w where the last event was */
    int64_t counts;     /* since then; elastic only */
    long double travel; /* since then; plastic only */
    int plastic;        /* 0, or the direction in which it slides */
} exact_t;

static long double exact_w(const exact_t *r)
{
    if (r->plastic == 0) {
        return r->from + r->counts * r->u;
    }
    return r->from - (r->plastic - r->from) * expm1l(-r->travel / (1 - r->b));
}

static void event(exact_t *r, long double w, int plastic)
{
    r->from = w;
    r->counts = 0;
    r->travel = 0;
    r->plastic = plastic;
}

static long double exact_move(exact_t *r, int32_t counts)
{
    int s = (counts > 0) - (counts < 0);
    long double travel = fabsl((long double)counts) * r->u, to_breakaway = r->b - s * exact_w(r);
    if (s == 0) {
        return exact_w(r);
    }
    if (r->plastic != s && to_breakaway <= 0) { /* back to sliding, with part of the range beyond b still to go */
        event(r, exact_w(r), s);
    } else if (r->plastic != s && travel > to_breakaway) {
        event(r, s * r->b, s);
        travel -= to_breakaway;
    } else if (r->plastic == -s) {
        event(r, exact_w(r), 0);
    }
    r->counts += r->plastic == 0 ? counts : 0;
    r->travel += travel;
    return exact_w(r);
}

static dahl_elastoplastic_plan_t elastoplastic_plan(const dahl_params_t *p, float b)
{
    dahl_elastoplastic_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_elastoplastic_prepare(&plan, p, b));
    return plan;
}

static long double worst_error(const dahl_params_t *p, float b, motion_fn next, int ticks, long double *q30)
{
    dahl_elastoplastic_plan_t plan = elastoplastic_plan(p, b);
    dahl_state_t state = {0}, other = {0};
    exact_t exact = {(long double)p->sigma0 / p->Fc * p->theta_per_count, b, 0, 0, 0, 0};
    motion_t motion = MOTION_START;
    long double worst = 0;
    *q30 = 0;
    for (int t = 0; t < ticks; t++) {
        int32_t d = next(&motion);
        long double w = exact_move(&exact, d);
        worst = fmaxl(worst, fabsl(dahl_elastoplastic_step_counts(&plan, &state, d) - w * p->Fc));
        *q30 = fmaxl(*q30, fabsl(dahl_elastoplastic_step_counts_q30(&plan, &other, d) - w * 0x1p30L));
    }
    TEST_ASSERT_TRUE(state.w == other.w);
    return worst / ulp_of(p->Fc);
}

static void test_hard_motions(void)
{
    static const double travels[] = {1e-9, 1e-6, 1e-4, 1e-2, 0.3, 1.1, 3.0, 20.0};
    static const float breakaways[] = {0.5f, 0.9f, 0.001f, 0.25f, 0.999f, 1e-6f, 0.7f};
    long double over_all = 0;
    for (size_t i = 0; i < 8; i++) {
        for (size_t m = 0; m < MOTIONS; m++) {
            float Fc = i % 2 ? 3.99f : 0.0371f, b = breakaways[(i + m) % 7];
            dahl_params_t p = params_for(travels[i], Fc);
            long double q30, worst = worst_error(&p, b, motions[m].next, TEST_TICKS, &q30);
            printf("elastoplastic %-8s travel %.0e b %g  worst %.4Lf ulp, %.2Lf units\n", motions[m].name, travels[i], (double)b,
                   worst, q30);
            TEST_ASSERT_TRUE_MESSAGE(worst <= DAHL_ULP_PARTS, motions[m].name);
            TEST_ASSERT_TRUE_MESSAGE(q30 * DAHL_Q30 <= DAHL_ELASTOPLASTIC_ERROR_Q30, motions[m].name);
            over_all = fmaxl(over_all, worst);
        }
    }
    TEST_ASSERT_TRUE(over_all > 0.49L);
}

/* Below breakaway a way to and fro leaves no trace, however often and however it is cut in pieces. */
static void test_zero_drift(void)
{
    dahl_params_t p = params_for(0.25 / 40, 1.3f);
    dahl_elastoplastic_plan_t plan = elastoplastic_plan(&p, 0.6f);
    dahl_state_t state = {0};
    (void)dahl_elastoplastic_step_counts(&plan, &state, 40); /* Fc/4 */
    const int64_t start = state.w;
    for (int t = 0; t < 10 * TEST_TICKS; t++) {
        (void)dahl_elastoplastic_step_counts_q30(&plan, &state, t & 1 ? -1 : 1);
    }
    TEST_ASSERT_TRUE(state.w == start);
    (void)dahl_elastoplastic_step_counts(&plan, &state, -90);
    (void)dahl_elastoplastic_step_counts(&plan, &state, 45);
    (void)dahl_elastoplastic_step_counts(&plan, &state, 5);
    TEST_ASSERT_TRUE(state.w == 0 && dahl_elastoplastic_step_counts(&plan, &state, 0) == 0.0f);
}

/* Odd symmetry bit for bit, bounds, zero motion is the identity. */
static void test_bounds_and_symmetry(void)
{
    static const double travels[] = {1e-7, 1e-4, 0.02, 0.7, 5.0};
    for (size_t i = 0; i < 5 * MOTIONS; i++) {
        dahl_params_t p = params_for(travels[i % 5], 2.5f);
        dahl_elastoplastic_plan_t plan = elastoplastic_plan(&p, 0.3f);
        dahl_state_t x = {0}, y = {0};
        motion_t m = MOTION_START;
        for (int t = 0; t < 20000; t++) {
            int32_t d = motions[i / 5].next(&m);
            d = d == INT32_MIN ? -INT32_MAX : d;
            float F = dahl_elastoplastic_step_counts(&plan, &x, d);
            TEST_ASSERT_TRUE(F >= -p.Fc && F <= p.Fc);
            TEST_ASSERT_TRUE(dahl_elastoplastic_step_counts(&plan, &y, -d) == -F && y.w == -x.w);
            int64_t before = x.w;
            TEST_ASSERT_TRUE(dahl_elastoplastic_step_counts(&plan, &x, 0) == F && x.w == before);
        }
        TEST_ASSERT_TRUE(dahl_elastoplastic_step_counts(&plan, &x, INT32_MAX) == p.Fc);
        TEST_ASSERT_TRUE(dahl_elastoplastic_step_counts(&plan, &x, INT32_MIN) == -p.Fc);
    }
}

/* sigma0 up to breakaway and right behind it, where the slope is continuous; sigma0 right after a reversal. */
static void test_slopes(void)
{
    dahl_params_t p = params_for(1e-5, 1.0f);
    dahl_elastoplastic_plan_t plan = elastoplastic_plan(&p, 0.5f);
    dahl_state_t state = {0};
    double slope = (double)p.sigma0 * (double)THETA, F = 0;
    for (int32_t n = 0; n < 60000; n += 100) {
        double before = F, expected = F < 0.5 ? 100 * slope : 2 * (1 - F) * 100 * slope;
        F = (double)dahl_elastoplastic_step_counts(&plan, &state, 100);
        TEST_ASSERT_DOUBLE_WITHIN(2e-3 * expected, expected, F - before);
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-4 * 100 * slope, F - 100 * slope, (double)dahl_elastoplastic_step_counts(&plan, &state, -100));
}

/* One move is the moves that it is made of, across the breakaway too; more travel never leads back. */
static void test_composition_and_monotony(void)
{
    static const double travels[] = {1e-3, 0.02, 0.4, 1.5, 2.5};
    for (size_t i = 0; i < 5; i++) {
        dahl_params_t p = params_for(travels[i], 1.37f);
        dahl_elastoplastic_plan_t plan = elastoplastic_plan(&p, 0.45f);
        float before = -p.Fc;
        for (int32_t n = 1; n < 3000; n++) {
            dahl_state_t once, twice;
            dahl_set_torque(&plan.plastic, &once, -0.9f);
            twice = once;
            float F = dahl_elastoplastic_step_counts(&plan, &once, n);
            (void)dahl_elastoplastic_step_counts(&plan, &twice, n / 3);
            float parts = dahl_elastoplastic_step_counts(&plan, &twice, n - n / 3);
            TEST_ASSERT_TRUE(fabsf(parts - F) <= 1.1L * ulp_of(p.Fc));
            TEST_ASSERT_TRUE(F > before || (F == before && F > p.Fc * 0.9999f));
            before = F;
        }
    }
}

/* The shaft gives at least what the bristle stores, F^2/(2 sigma0) while it is a spring: over any motion from rest the work, F over
 * dtheta by the mean of before and after, which is exact while elastic and less than the curve while sliding, is not negative. */
static void test_passive(void)
{
    dahl_params_t p = params_for(0.03, 1.0f);
    dahl_elastoplastic_plan_t plan = elastoplastic_plan(&p, 0.5f);
    dahl_state_t state = {0};
    motion_t m = MOTION_START;
    long double work = 0, F = 0;
    for (int t = 0; t < 200000; t++) {
        int32_t d = motion_walk(&m);
        for (int i = 0; i < abs(d); i++) {
            long double after = dahl_elastoplastic_step_counts(&plan, &state, d < 0 ? -1 : 1);
            work += (F + after) / 2 * (d < 0 ? -1 : 1) * THETA;
            F = after;
        }
        TEST_ASSERT_TRUE(work >= F * F / (2 * p.sigma0) - 1e-9L);
    }
}

/* Beyond breakaway by any part of a count, down to the least: the slope is continuous there, so x is the way that was moved less
 * what the curve takes from it, (rest)^2 kappa/2 at most. */
static void test_crossing_by_little(void)
{
    static const double travels[] = {1.0 / (1 << 29), 1e-6, 1e-3};
    for (size_t i = 0; i < 3 * 60; i++) {
        dahl_params_t p = params_for(travels[i % 3], 1.0f);
        dahl_elastoplastic_plan_t plan = elastoplastic_plan(&p, 0.5f);
        long double u = (long double)p.sigma0 / p.Fc * p.theta_per_count, before = 0.5L - u + ldexpl(u, -(int)(i / 3));
        dahl_state_t state = {(int64_t)ldexpl(before, 62)};
        long double rest = ldexpl(state.w, -62) + u - 0.5L;
        (void)dahl_elastoplastic_step_counts(&plan, &state, 1);
        long double beyond = ldexpl(state.w, -62) - 0.5L;
        TEST_ASSERT_TRUE(fabsl(beyond - 0.5L * -expm1l(-2 * rest)) <= 4e-9L * rest + 1e-15L);
    }
}

/* The plan is untouched on an error. */
static dahl_err_t try(float sigma0, float Fc, float theta_per_count, float b)
{
    const dahl_params_t p = {sigma0, Fc, theta_per_count};
    dahl_elastoplastic_plan_t plan, untouched;
    memset(&plan, 0x5a, sizeof plan);
    memcpy(&untouched, &plan, sizeof plan);
    dahl_err_t err = dahl_elastoplastic_prepare(&plan, &p, b);
    TEST_ASSERT_TRUE(err == DAHL_OK || memcmp(&plan, &untouched, sizeof plan) == 0);
    return err;
}

static void test_refused(void)
{
    static const float bad[] = {0.0f, -0.0f, -1.0f, -1e-45f, NAN, -NAN, HUGE_VALF, -HUGE_VALF};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(bad[i], 1.0f, 1e-3f, 0.5f));
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(1.0f, bad[i], 1e-3f, 0.5f));
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(1.0f, 1.0f, bad[i], 0.5f));
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(1.0f, 1.0f, 1e-3f, bad[i]));
    }
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(1.0f, 1.0f, 1e-3f, 1.0f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(1.0f, 1.0f, 1e-3f, 1e30f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(1.0f, 1.0f, 1e-20f, 0.5f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(1.0f, 1.0f, 0x1p-31f, 0.5f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(1.0f, 1.0f, 0x1p20f, 0.5f));
    TEST_ASSERT_EQUAL_INT(DAHL_OK, try(1.0f, 1.0f, 0x1p-30f, 1e-45f));
    TEST_ASSERT_EQUAL_INT(DAHL_OK, try(1.0f, 1.0f, 0x1.fffffep19f, 0x1.fffffep-1f));
}

/* The ends of both ranges: breakaway near 0 and near 1, a count of the least travel and of the most. */
static void test_ends_of_the_ranges(void)
{
    static const float breakaways[] = {1e-45f, 1e-10f, 0x1p-31f, 0x1.fffffep-1f, 0x1.fffffcp-1f};
    static const double travels[] = {1.0 / (1 << 29), 1e-3, 1.0, 1.999999, 2.0, 2.000001, 63.9, 64.1, 1e6};
    for (size_t i = 0; i < 5 * 9; i++) {
        dahl_params_t p = params_for(travels[i / 5], 1.0f);
        long double q30, worst = worst_error(&p, breakaways[i % 5], motion_leap, 3000, &q30);
        TEST_ASSERT_TRUE(worst <= DAHL_ULP_PARTS && q30 * DAHL_Q30 <= DAHL_ELASTOPLASTIC_ERROR_Q30);
        worst = worst_error(&p, breakaways[i % 5], motion_two_one, 3000, &q30);
        TEST_ASSERT_TRUE(worst <= DAHL_ULP_PARTS && q30 * DAHL_Q30 <= DAHL_ELASTOPLASTIC_ERROR_Q30);
    }
}

/* Any word as a state, and a plan of zeros: no undefined behaviour (seen under the sanitizers), and no end that is not reached. */
static void test_any_word_as_a_state(void)
{
    static const int64_t words[] = {INT64_MIN, INT64_MIN + 1, -((int64_t)1 << 62) - ((int64_t)1 << 32), -1, 0, 1, INT64_MAX};
    static const int32_t counts[] = {0, 1, -1, 8, -9, 1000, INT32_MAX, INT32_MIN};
    static const dahl_elastoplastic_plan_t zero;
    for (size_t i = 0; i < 7 * 8; i++) {
        dahl_params_t fine = params_for(1e-3, 1.0f), coarse = params_for(2.0, 1.0f);
        const dahl_elastoplastic_plan_t plans[] = {elastoplastic_plan(&fine, 0.5f), elastoplastic_plan(&coarse, 0.5f), zero};
        for (size_t k = 0; k < 3; k++) {
            dahl_state_t state = {words[i / 8]};
            float F = dahl_elastoplastic_step_counts(&plans[k], &state, counts[i % 8]);
            TEST_ASSERT_TRUE(k < 2 || (F == 0.0f && state.w == words[i / 8]));
        }
    }
}

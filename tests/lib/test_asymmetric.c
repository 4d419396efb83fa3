/* SPDX-License-Identifier: MIT */
/* Fc of each direction its own: the promise of dahl_parts.h, the laws, and what prepare refuses. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dahl_parts.h"
#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif

/* The exact torque: long double, anchored at the last reversal. */
typedef struct {
    const dahl_asymmetric_params_t *p;
    long double F_reversal;
    long double travel; /* rad since then */
    int direction;
} exact_t;

static long double exact_F(const exact_t *r)
{
    long double Fc = r->direction < 0 ? r->p->Fc_backward : r->p->Fc_forward;
    return r->F_reversal - (r->direction * Fc - r->F_reversal) * expm1l(-r->p->sigma0 / Fc * r->travel);
}

static long double exact_move(exact_t *r, int32_t counts)
{
    int direction = (counts > 0) - (counts < 0);
    if (direction != 0 && direction != r->direction) {
        r->F_reversal = exact_F(r);
        r->travel = 0;
        r->direction = direction;
    }
    r->travel += fabsl((long double)counts) * r->p->theta_per_count;
    return exact_F(r);
}

static dahl_asymmetric_plan_t asymmetric_plan(const dahl_asymmetric_params_t *p)
{
    dahl_asymmetric_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_asymmetric_prepare(&plan, p));
    return plan;
}

static float larger_Fc(const dahl_asymmetric_params_t *p)
{
    return p->Fc_forward > p->Fc_backward ? p->Fc_forward : p->Fc_backward;
}

/* Parameters whose travel per count is near u for the larger Fc. */
static dahl_asymmetric_params_t asymmetric_params(double u, float Fc_forward, float Fc_backward)
{
    float Fc = Fc_forward > Fc_backward ? Fc_forward : Fc_backward;
    dahl_asymmetric_params_t p = {(float)(u * (double)Fc / (double)THETA), Fc_forward, Fc_backward, THETA};
    return p;
}

/* Worst error of the torque in ulp of the larger Fc, and of the Q30 result in units. */
static long double worst_error(const dahl_asymmetric_params_t *p, motion_fn next, int ticks, long double *q30)
{
    dahl_asymmetric_plan_t plan = asymmetric_plan(p);
    dahl_state_t state = {0}, other = {0};
    exact_t exact = {p, 0, 0, 0};
    motion_t motion = MOTION_START;
    long double worst = 0;
    *q30 = 0;
    for (int t = 0; t < ticks; t++) {
        int32_t d = next(&motion);
        long double F = exact_move(&exact, d);
        worst = fmaxl(worst, fabsl(dahl_asymmetric_step_counts(&plan, &state, d) - F));
        *q30 = fmaxl(*q30, fabsl(dahl_asymmetric_step_counts_q30(&plan, &other, d) - F / larger_Fc(p) * 0x1p30L));
    }
    TEST_ASSERT_TRUE(state.w == other.w);
    return worst / ulp_of(larger_Fc(p));
}

static void test_hard_motions(void)
{
    static const double travels[] = {1e-9, 1e-6, 1e-4, 1e-2, 0.3, 3.0, 20.0};
    static const float Fc[][2] = {{1.99f, 1.31f}, {0.0371f, 0.9f}, {2.739f, 2.5f}, {7.99f, 0.01f}};
    long double over_all = 0;
    for (size_t i = 0; i < 7; i++) {
        for (size_t m = 0; m < MOTIONS; m++) {
            const float *pair = Fc[(i + m) % 4];
            dahl_asymmetric_params_t p = asymmetric_params(travels[i], pair[0], pair[1]);
            long double q30, worst = worst_error(&p, motions[m].next, TEST_TICKS, &q30);
            printf("asymmetric %-8s travel %.0e Fc %g %g  worst %.4Lf ulp, %.2Lf units\n", motions[m].name, travels[i],
                   (double)pair[0], (double)pair[1], worst, q30);
            TEST_ASSERT_TRUE_MESSAGE(worst <= DAHL_ULP_PARTS, motions[m].name);
            TEST_ASSERT_TRUE_MESSAGE(q30 * DAHL_Q30 <= DAHL_ASYMMETRIC_ERROR_Q30, motions[m].name);
            over_all = fmaxl(over_all, worst);
        }
    }
    TEST_ASSERT_TRUE(over_all > 0.49L); /* half an ulp is the rounding to float: the comparison does compare */
}

/* Where the motion has one direction, it ends at that direction's Fc, exactly. */
static void test_ends(void)
{
    static const float Fc[][2] = {{1.99f, 1.31f}, {0.0371f, 0.9f}, {2.0f, 2.0f}, {0x1p-64f, 0x1p-60f}, {1.0f, 0.0156251f}};
    for (size_t i = 0; i < 5; i++) {
        dahl_asymmetric_params_t p = asymmetric_params(1e-3, Fc[i][0], Fc[i][1]);
        dahl_asymmetric_plan_t plan = asymmetric_plan(&p);
        dahl_state_t state = {0};
        TEST_ASSERT_TRUE(dahl_asymmetric_step_counts(&plan, &state, 0) == 0.0f && state.w == 0);
        TEST_ASSERT_TRUE(dahl_asymmetric_step_counts(&plan, &state, INT32_MAX) == p.Fc_forward);
        TEST_ASSERT_TRUE(dahl_asymmetric_step_counts(&plan, &state, 0) == p.Fc_forward);
        TEST_ASSERT_TRUE(dahl_asymmetric_step_counts(&plan, &state, INT32_MIN) == -p.Fc_backward);
    }
}

/* Relaxed the slope is sigma0 both ways, whatever Fc. */
static void test_slopes_at_rest(void)
{
    dahl_asymmetric_params_t p = asymmetric_params(1e-6, 1.0f, 0.3f);
    dahl_asymmetric_plan_t plan = asymmetric_plan(&p);
    double expected = (double)p.sigma0 * (double)THETA;
    for (int s = -1; s <= 1; s += 2) {
        dahl_state_t state = {0};
        double F = (double)dahl_asymmetric_step_counts(&plan, &state, s);
        TEST_ASSERT_DOUBLE_WITHIN(3e-6 * expected, s * expected, F);
    }
}

/* Fc exchanged mirrors the motion, but for half a unit of Q30 where w is a tie; with equal Fc it is Dahl's model. */
static void test_mirrored(void)
{
    dahl_asymmetric_params_t p = asymmetric_params(0.01, 1.7f, 1.1f), q = {p.sigma0, p.Fc_backward, p.Fc_forward, THETA};
    dahl_asymmetric_params_t same = {p.sigma0, 1.7f, 1.7f, THETA};
    dahl_params_t one = {p.sigma0, 1.7f, THETA};
    dahl_asymmetric_plan_t plan = asymmetric_plan(&p), mirrored = asymmetric_plan(&q), equal = asymmetric_plan(&same);
    dahl_plan_t dahl = plan_for(&one);
    dahl_state_t x = {0}, y = {0}, z = {0}, w = {0};
    motion_t m = MOTION_START;
    for (int t = 0; t < 20000; t++) {
        int32_t d = motion_walk(&m) * (t % 7 == 0 ? 100 : 1);
        float F = dahl_asymmetric_step_counts(&plan, &x, d);
        TEST_ASSERT_TRUE(dahl_asymmetric_step_counts(&mirrored, &y, -d) == -F);
        float expected = dahl_step_counts(&dahl, &w, d);
        TEST_ASSERT_TRUE(fabsf(dahl_asymmetric_step_counts(&equal, &z, d) - expected) <= ulp_of(one.Fc));
    }
}

/* One move is the moves that it is made of, and more travel never leads back. */
static void test_composition_and_monotony(void)
{
    dahl_asymmetric_params_t p = asymmetric_params(1e-3, 0.8f, 1.37f);
    dahl_asymmetric_plan_t plan = asymmetric_plan(&p);
    for (int s = -1; s <= 1; s += 2) {
        float before = 0;
        for (int32_t n = 1; n < 3000; n++) {
            dahl_state_t once = {0}, twice = {0};
            float F = dahl_asymmetric_step_counts(&plan, &once, s * n);
            (void)dahl_asymmetric_step_counts(&plan, &twice, s * (n / 3));
            TEST_ASSERT_TRUE(fabsf(dahl_asymmetric_step_counts(&plan, &twice, s * (n - n / 3)) - F) <= 1.01L * ulp_of(1.37f));
            TEST_ASSERT_TRUE(s > 0 ? F > before : F < before);
            before = F;
        }
    }
}

/* Over cycles that close in angle and torque the shaft only gives: the work of each tick, F over dtheta by the exact curve, is
 * Fc |dtheta| - s (Fc/sigma0) (F after - F before) with the Fc of its direction. */
static void test_passive(void)
{
    dahl_asymmetric_params_t p = asymmetric_params(0.05, 1.9f, 0.4f);
    dahl_asymmetric_plan_t plan = asymmetric_plan(&p);
    motion_t m = MOTION_START;
    for (int cycle = 0; cycle < 2000; cycle++) {
        int32_t way[6];
        long double work = 0, F = 0;
        dahl_state_t state = {0};
        for (int i = 0; i < 6; i++) {
            way[i] = motion_walk(&m) * (1 + cycle % 5);
        }
        for (int t = 0; t < 6 * 200; t++) {
            int32_t d = t % 6 == 5 ? -(way[0] + way[1] + way[2] + way[3] + way[4]) : way[t % 6];
            long double Fc = d < 0 ? p.Fc_backward : p.Fc_forward, after = dahl_asymmetric_step_counts(&plan, &state, d);
            long double W = Fc * abs(d) * THETA - (d < 0 ? -1 : 1) * Fc / p.sigma0 * (after - F);
            work += t >= 6 * 199 ? W : 0;
            F = after;
        }
        TEST_ASSERT_TRUE(work >= -1e-6L * p.Fc_forward * p.Fc_forward / p.sigma0);
    }
}

/* The plan is untouched on an error. */
static dahl_err_t try(float sigma0, float Fc_forward, float Fc_backward, float theta_per_count)
{
    const dahl_asymmetric_params_t p = {sigma0, Fc_forward, Fc_backward, theta_per_count};
    dahl_asymmetric_plan_t plan, untouched;
    memset(&plan, 0x5a, sizeof plan);
    memcpy(&untouched, &plan, sizeof plan);
    dahl_err_t err = dahl_asymmetric_prepare(&plan, &p);
    TEST_ASSERT_TRUE(err == DAHL_OK || memcmp(&plan, &untouched, sizeof plan) == 0);
    return err;
}

static void test_refused(void)
{
    static const float bad[] = {0.0f, -0.0f, -1.0f, -1e-45f, NAN, -NAN, HUGE_VALF, -HUGE_VALF};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(bad[i], 1.0f, 1.0f, 1e-3f));
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(1.0f, bad[i], 1.0f, 1e-3f));
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(1.0f, 1.0f, bad[i], 1e-3f));
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(1.0f, 1.0f, 1.0f, bad[i]));
    }
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(DAHL_TORQUE_MAX, 1e18f, 1e18f, 1e-3f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(1.0f, 1e-20f, 1.0f, 1e-3f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(1.0f, 1.0f, 0x1p22f, 0x1p-9f)); /* travel of a count too small backward alone */
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(1.0f, 0x1p-20f, 1.0f, 1.0f));   /* too large forward alone */
    TEST_ASSERT_EQUAL_INT(DAHL_OK, try(1.0f, 0x1p21f, 1.0f, 0x1p-9f));
}

static void test_a_plan_of_zeros(void)
{
    static const dahl_asymmetric_plan_t zero;
    static const int32_t counts[] = {0, 1, -1, 8, -9, INT32_MAX, INT32_MIN};
    dahl_state_t state = {(int64_t)1 << 60};
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; i++) {
        TEST_ASSERT_TRUE(dahl_asymmetric_step_counts(&zero, &state, counts[i]) == 0.0f && state.w == (int64_t)1 << 60);
    }
}

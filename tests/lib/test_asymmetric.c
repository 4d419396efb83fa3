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

/* SPDX-License-Identifier: MIT */
/* dahl_counts_to_torque: the move that it returns reaches the torque, shorter moves do not, and its length is that of a
 * logarithm in long double. dahl_tip_torque is compared with tanh in long double. */
#include <stdio.h>

#include "dahl_parts.h"
#include "motions.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TRIES 20000
#else
#define TRIES (TEST_TICKS < 20000 ? TEST_TICKS : 20000)
#endif
#define NEIGHBOURS (TRIES / 5)

static const double travels[] = {1.1e-9, 1e-7, 1e-5, 1e-3, 0.1, 3.0, 20.0};
#define TRAVELS (sizeof travels / sizeof travels[0])

static float after(const dahl_plan_t *plan, dahl_state_t state, int32_t dcounts)
{
    return dahl_step_counts(plan, &state, dcounts);
}

static float random_torque(motion_t *m, float Fc)
{
    return Fc * (float)((int32_t)motion_random(m) >> (motion_random(m) & 7u)) / 2147483648.0f;
}

static void check_one(const dahl_plan_t *plan, const dahl_state_t *state, float F)
{
    int32_t n = 12345;
    float here = dahl_torque(plan, state);
    dahl_state_t before = *state;
    dahl_err_t err = dahl_counts_to_torque(plan, state, F, &n);
    TEST_ASSERT_EQUAL_MEMORY(&before, state, sizeof before);
    if (err != DAHL_OK) {
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, err);
        TEST_ASSERT_EQUAL_INT32(12345, n);
        TEST_ASSERT_TRUE(F > here ? after(plan, *state, INT32_MAX) < F : after(plan, *state, -INT32_MAX) > F);
    } else if (n > 0) {
        TEST_ASSERT_TRUE(here < F && after(plan, *state, n) >= F && after(plan, *state, n - 1) < F);
    } else if (n < 0) {
        TEST_ASSERT_TRUE(F < here && after(plan, *state, n) <= F && after(plan, *state, n + 1) > F);
    } else {
        TEST_ASSERT_TRUE(F == here);
    }
}

typedef struct {
    const dahl_plan_t *plan;
    dahl_state_t state;
    dahl_params_t p;
    float F;
    int s;               /* direction of the move */
    int32_t found;       /* counts that the library returns */
    long double earlier; /* counts by which a shorter move may reach F too */
    int32_t least;       /* the shortest move seen to reach F */
} search_t;

/* The gap from F to Fc in the direction of the move, as a fraction of Fc and at least 2^-25, as in the header. */
static long double gap_to_Fc(const search_t *x)
{
    return fmaxl(1 - x->s * (long double)x->F / x->p.Fc, 0x1p-25L);
}

/* A shorter move may reach F within the rounding only, and only if it is not much shorter. */
static void check_shorter(search_t *x, int32_t counts)
{
    const float F = after(x->plan, x->state, x->s * counts);
    if (x->s > 0 ? F < x->F : F > x->F) {
        return;
    }
    const long double beyond = x->s * ((long double)F - x->F) / x->p.Fc;
    TEST_ASSERT_TRUE(beyond <= (long double)DAHL_INVERSE_ERROR + 0.51L * ulp_of(fabsf(F)) / x->p.Fc);
    TEST_ASSERT_TRUE(x->found - counts <= 1 + x->earlier);
    x->least = counts < x->least ? counts : x->least;
}

/* The exact length is ln((1 - s w)/gap_to_Fc)/u counts. The float F is uncertain by half an ulp, u by 6e-11. */
static void check_logarithm(const search_t *x, long double u)
{
    const long double gap = 1 - x->s * (long double)x->state.w * 0x1p-62L, half = ulp_of(fabsf(x->F)) / x->p.Fc / 2;
    const long double least = logl(gap / (gap_to_Fc(x) + half)) / u, most = logl(gap / fmaxl(gap_to_Fc(x) - half, 0x1p-26L)) / u;
    TEST_ASSERT_TRUE(x->found >= least - x->earlier - 6e-11L * x->found);
    TEST_ASSERT_TRUE(x->found <= most + x->earlier + 6e-11L * x->found + 1);
}

/* Check the next shorter moves, moves within the allowed window, and random shorter moves. */
static search_t check_neighbours(const dahl_plan_t *plan, const dahl_params_t *p, int64_t w, float F, motion_t *m)
{
    search_t x = {plan, {w}, *p, F, 1, 0, 0, 0};
    const long double u = reference_by_counts(p).a;
    if (dahl_counts_to_torque(plan, &x.state, F, &x.found) != DAHL_OK || x.found == 0) {
        return x;
    }
    x.s = x.found < 0 ? -1 : 1;
    x.found *= x.s;
    x.least = x.found;
    x.earlier = DAHL_INVERSE_ERROR / (u * gap_to_Fc(&x));
    check_logarithm(&x, u);
    const uint32_t window = (uint32_t)fminl(1.5L * x.earlier + 1, (long double)x.found);
    for (int i = 1; i <= NEIGHBOURS; i++) {
        check_shorter(&x, x.found > i ? x.found - i : 0);
        check_shorter(&x, x.found - 1 - (int32_t)(motion_random(m) % window));
        check_shorter(&x, (int32_t)(motion_random(m) % (uint32_t)x.found));
    }
    return x;
}

/* Random plan and state; half of the torques are within a few floats of Fc. Return the used fraction of the header's bound. */
static long double check_any_neighbours(motion_t *m)
{
    const float Fc = 1.0f + (float)(motion_random(m) >> 9) * 0x1p-23f;
    const dahl_params_t p = params_for(pow(2.0, motion_random(m) * 0x1p-32 * 26 - 29.5), motion_random(m) % 4 == 0 ? 1.0f : Fc);
    const dahl_plan_t plan = plan_for(&p);
    const int64_t w = motion_random(m) % 2 ? (int64_t)((uint64_t)motion_random(m) << 32 | motion_random(m)) >> 1 : 0;
    float F = random_torque(m, p.Fc);
    if (motion_random(m) % 2 == 0) {
        F = copysignf(p.Fc - (float)(motion_random(m) % 4) * (float)ulp_of(p.Fc / 2), F);
    }
    const search_t x = check_neighbours(&plan, &p, w, F, m);
    return x.earlier > 3 ? (x.found - x.least) / (1 + x.earlier) : 0;
}

static void test_a_shorter_move_reaches_the_torque_within_rounding_only(void)
{
    const dahl_params_t p = {1.0f, 1.0f, 1e-5f};
    const dahl_plan_t plan = plan_for(&p);
    motion_t m = MOTION_START;
    const search_t seen = check_neighbours(&plan, &p, 0, p.Fc, &m);
    TEST_ASSERT_TRUE(seen.found - seen.least > 300);
    long double worst = 0;
    for (int i = 0; i < TRIES / 40; i++) {
        worst = fmaxl(worst, check_any_neighbours(&m));
    }
    printf("shorter moves that reach F: %.3Lf of the bound\n", worst);
}

static void test_the_move_reaches_the_torque_and_one_count_less_does_not(void)
{
    motion_t m = MOTION_START;
    for (size_t i = 0; i < TRAVELS; i++) {
        dahl_params_t p = params_for(travels[i], 0.5f);
        dahl_plan_t plan = plan_for(&p);
        for (int k = 0; k < TRIES; k++) {
            dahl_state_t state = {0};
            dahl_set_torque(&plan, &state, random_torque(&m, p.Fc));
            check_one(&plan, &state, random_torque(&m, p.Fc));
        }
    }
}

/* There a count changes the torque by a rounding or not at all. */
static void test_moves_between_the_ends_and_their_neighbours(void)
{
    for (size_t i = 0; i < TRAVELS; i++) {
        dahl_params_t p = params_for(travels[i], 0.7f);
        dahl_plan_t plan = plan_for(&p);
        const float ends[] = {p.Fc, -p.Fc, nextafterf(p.Fc, 0), -nextafterf(p.Fc, 0), 0.0f, -0.0f, 1e-12f, -1e-12f};
        for (size_t from = 0; from < sizeof ends / sizeof ends[0]; from++) {
            for (size_t to = 0; to < sizeof ends / sizeof ends[0]; to++) {
                dahl_state_t state = {0};
                dahl_set_torque(&plan, &state, ends[from]);
                check_one(&plan, &state, ends[to]);
            }
        }
    }
}

static void test_torques_out_of_reach_are_refused(void)
{
    dahl_params_t p = params_for(1e-3, 0.5f), slow = params_for(1e-9, 0.5f);
    dahl_plan_t plan = plan_for(&p), fine = plan_for(&slow), zeros = {0};
    dahl_state_t state = {0};
    int32_t n = 7;
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, dahl_counts_to_torque(&plan, &state, NAN, &n));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, dahl_counts_to_torque(&plan, &state, INFINITY, &n));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, dahl_counts_to_torque(&plan, &state, -INFINITY, &n));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, dahl_counts_to_torque(&plan, &state, 0.51f, &n));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, dahl_counts_to_torque(&fine, &state, -0.499f, &n));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, dahl_counts_to_torque(&zeros, &state, 0.1f, &n));
    TEST_ASSERT_EQUAL_INT32(7, n);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_counts_to_torque(&zeros, &state, 0.0f, &n));
    TEST_ASSERT_EQUAL_INT32(0, n);
}

static void test_the_tip_of_a_loop_is_tanh(void)
{
    motion_t m = MOTION_START;
    for (size_t i = 0; i < TRAVELS; i++) {
        dahl_params_t p = params_for(travels[i], 0.5f);
        dahl_plan_t plan = plan_for(&p);
        long double u = reference_by_counts(&p).a;
        for (int k = 0; k < TRIES; k++) {
            uint32_t stroke = motion_random(&m) >> (motion_random(&m) & 31u);
            long double exact = p.Fc * tanhl(u * stroke / 2), error = fabsl(dahl_tip_torque(&plan, stroke) - exact);
            TEST_ASSERT_TRUE(error <= 0x1p-30L * exact + 0.51L * ulp_of((float)exact));
        }
    }
    dahl_params_t p = params_for(1e-3, 0.5f);
    dahl_plan_t plan = plan_for(&p), zeros = {0};
    TEST_ASSERT_TRUE(dahl_tip_torque(&plan, 0) == 0.0f && dahl_tip_torque(&zeros, 1000) == 0.0f);
    TEST_ASSERT_TRUE(dahl_tip_torque(&plan, UINT32_MAX) == p.Fc);
}

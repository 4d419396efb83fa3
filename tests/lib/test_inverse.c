/* SPDX-License-Identifier: MIT */
/* dahl_counts_to_torque near Fc and out of reach; test_part_laws.c has any torques. dahl_tip_torque is compared with tanh in
 * long double. */
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

/* A shorter move may reach F within the rounding only. Return how much shorter it is. */
static int32_t check_shorter(const dahl_plan_t *plan, const dahl_params_t *p, float F, int32_t found, int32_t counts)
{
    const dahl_state_t rest = {0};
    const float reached = after(plan, rest, counts);
    if (reached < F) {
        return 0;
    }
    TEST_ASSERT_TRUE(((long double)reached - F) / p->Fc <= (long double)DAHL_INVERSE_ERROR + 0.51L * ulp_of(reached) / p->Fc);
    return found - counts;
}

/* From rest to Fc less a few floats, where rounding reorders the moves. The gap to Fc is at least 2^-25, as in the header. */
static void test_a_shorter_move_reaches_the_torque_within_rounding_only(void)
{
    const dahl_params_t p = params_for(1e-5, 1.0f);
    const dahl_plan_t plan = plan_for(&p);
    const dahl_state_t rest = {0};
    motion_t m = MOTION_START;
    int32_t most = 0;
    for (int floats = 0; floats < 8; floats++) {
        const float F = p.Fc - (float)floats * 0x1p-24f;
        const long double gap = fmaxl(1 - (long double)F, 0x1p-25L), earlier = DAHL_INVERSE_ERROR / (1e-5L * gap);
        int32_t found = 0;
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_counts_to_torque(&plan, &rest, F, &found));
        for (int32_t i = 1; i <= NEIGHBOURS; i++) {
            const int32_t next = check_shorter(&plan, &p, F, found, found - i);
            const int32_t any = check_shorter(&plan, &p, F, found, (int32_t)(motion_random(&m) % (uint32_t)found));
            most = next > most ? next : most;
            TEST_ASSERT_TRUE(next <= 1 + earlier && any <= 1 + earlier);
        }
    }
    TEST_ASSERT_TRUE(most > 300);
}

static void test_torques_out_of_reach_are_refused(void)
{
    dahl_params_t p = params_for(1e-3, 0.5f), slow = params_for(1e-9, 0.5f);
    dahl_plan_t plan = plan_for(&p), fine = plan_for(&slow), zeros = {0};
    dahl_state_t state = {0};
    int32_t n = 7;
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

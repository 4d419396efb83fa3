/* SPDX-License-Identifier: MIT */
/* Parts over a log: each tick has the bits of the same tick alone, and the state ends where that one ends. */
#include "dahl_batch.h"
#include "motions.h"
#include "plans.h"

#define TICKS 1000

static int32_t dcounts[TICKS];
static float F[TICKS];

static void make_log(void)
{
    motion_t m = MOTION_START;
    for (int t = 0; t < TICKS; t++) {
        dcounts[t] = (int32_t)(motion_random(&m) % 2001u) - 1000;
    }
}

static dahl_slip_plan_t slip_plan(void)
{
    dahl_slip_params_t params = {3, 1e-3f, {0.5f, 2.0f, 30.0f}, {0.2f, 0.3f, 0.4f}};
    dahl_slip_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_slip_prepare(&plan, &params));
    return plan;
}

static void test_slip_elements_over_a_log(void)
{
    const dahl_slip_plan_t plan = slip_plan();
    dahl_slip_state_t by_log = {{0}}, by_tick = {{0}};
    make_log();
    dahl_batch_slip_counts(&plan, &by_log, dcounts, F, TICKS);
    for (int t = 0; t < TICKS; t++) {
        TEST_ASSERT_TRUE(F[t] == dahl_slip_step_counts(&plan, &by_tick, dcounts[t]));
    }
    TEST_ASSERT_EQUAL_MEMORY(&by_tick, &by_log, sizeof by_tick);
}

static void test_a_mix_over_a_log(void)
{
    const dahl_params_t params = params_for(1e-3, 0.5f);
    const dahl_plan_t plan = plan_for(&params);
    const dahl_slip_plan_t slip = slip_plan();
    dahl_state_t bristle = {0}, bristle_by_tick = {0};
    dahl_slip_state_t elements = {{0}}, elements_by_tick = {{0}};
    const dahl_part_t parts[] = {dahl_batch_part(&plan, &bristle), dahl_batch_slip_part(&slip, &elements)};
    const dahl_part_t by_tick[] = {DAHL_PART(&plan, &bristle_by_tick), DAHL_SLIP_PART(&slip, &elements_by_tick)};
    make_log();
    dahl_batch_parallel_counts(parts, 2, dcounts, F, TICKS);
    for (int t = 0; t < TICKS; t++) {
        TEST_ASSERT_TRUE(F[t] == dahl_parallel_step_counts(by_tick, 2, dcounts[t]));
    }
    TEST_ASSERT_TRUE(bristle.w == bristle_by_tick.w);
    TEST_ASSERT_EQUAL_MEMORY(&elements_by_tick, &elements, sizeof elements);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_slip_elements_over_a_log);
    RUN_TEST(test_a_mix_over_a_log);
    return UNITY_END();
}

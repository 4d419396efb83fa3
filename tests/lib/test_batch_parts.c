/* SPDX-License-Identifier: MIT */
/* Parts over a log: each tick has the bits of the same tick alone, and the state ends where that one ends. */
#include "dahl_batch.h"
#include "motions.h"
#include "plans.h"

#define TICKS 1000

static int32_t dcounts[TICKS];
static float F[TICKS];

/* Each torque of the log is that of the tick with the number t. */
#define ASSERT_BY_TICK(tick)                \
    for (int t = 0; t < TICKS; t++) {       \
        TEST_ASSERT_TRUE(F[t] == (tick));   \
    }

void setUp(void)
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
    dahl_batch_slip_counts(&plan, &by_log, dcounts, F, TICKS);
    ASSERT_BY_TICK(dahl_slip_step_counts(&plan, &by_tick, dcounts[t]))
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
    dahl_batch_parallel_counts(parts, 2, dcounts, F, TICKS);
    ASSERT_BY_TICK(dahl_parallel_step_counts(by_tick, 2, dcounts[t]))
    TEST_ASSERT_TRUE(bristle.w == bristle_by_tick.w);
    TEST_ASSERT_EQUAL_MEMORY(&elements_by_tick, &elements, sizeof elements);
}

static void test_an_fc_of_each_direction_over_a_log(void)
{
    const dahl_asymmetric_params_t params = {100.0f, 0.5f, 0.3f, 1e-3f};
    dahl_asymmetric_plan_t plan;
    dahl_state_t by_log = {0}, by_tick = {0};
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_asymmetric_prepare(&plan, &params));
    dahl_batch_asymmetric_counts(&plan, &by_log, dcounts, F, TICKS);
    ASSERT_BY_TICK(dahl_asymmetric_step_counts(&plan, &by_tick, dcounts[t]))
    TEST_ASSERT_TRUE(by_log.w == by_tick.w);
}

static void test_a_load_over_a_log(void)
{
    static uint32_t load[TICKS];
    const dahl_params_t params = params_for(1e-3, 0.5f);
    const dahl_plan_t plan = plan_for(&params);
    dahl_loaded_state_t by_log = {{0}, 0}, by_tick = {{0}, 0};
    motion_t m = MOTION_START;
    for (int t = 0; t < TICKS; t++) {
        load[t] = motion_random(&m) >> 1;
    }
    dahl_batch_loaded_counts(&plan, &by_log, dcounts, load, F, TICKS);
    ASSERT_BY_TICK(dahl_loaded_step_counts(&plan, &by_tick, dcounts[t], load[t]))
    TEST_ASSERT_TRUE(by_log.bristle.w == by_tick.bristle.w && by_log.load_q30 == by_tick.load_q30);
}

static void test_elastoplastic_friction_over_a_log(void)
{
    const dahl_params_t params = params_for(1e-3, 0.5f);
    dahl_elastoplastic_plan_t plan;
    dahl_state_t by_log = {0}, by_tick = {0};
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_elastoplastic_prepare(&plan, &params, 0.6f));
    dahl_batch_elastoplastic_counts(&plan, &by_log, dcounts, F, TICKS);
    ASSERT_BY_TICK(dahl_elastoplastic_step_counts(&plan, &by_tick, dcounts[t]))
    TEST_ASSERT_TRUE(by_log.w == by_tick.w);
}

static void test_work_and_a_table_over_a_log(void)
{
    const dahl_params_t params = params_for(1e-3, 0.5f);
    const dahl_plan_t plan = plan_for(&params);
    dahl_velocity_params_t table = {.segment_bits = 4};
    dahl_velocity_plan_t over_speed;
    dahl_state_t by_log = {0}, by_tick = {0};
    dahl_work_t work = {{0}, {0}}, work_by_tick = {{0}, {0}};
    dahl_batch_work_counts(&plan, &by_log, &work, dcounts, F, TICKS);
    ASSERT_BY_TICK(dahl_work_step_counts(&plan, &by_tick, &work_by_tick, dcounts[t]))
    TEST_ASSERT_EQUAL_MEMORY(&work_by_tick, &work, sizeof work);
    for (int k = 0; k < DAHL_VELOCITY_SEGMENTS; k++) {
        table.torque[k] = 0.1f * (float)(k + 1);
    }
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_velocity_prepare(&over_speed, &table));
    dahl_batch_velocity(&over_speed, dcounts, F, TICKS);
    ASSERT_BY_TICK(dahl_velocity_torque(&over_speed, dcounts[t]))
}

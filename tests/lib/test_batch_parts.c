/* SPDX-License-Identifier: MIT */
/* Parts over a log have the bits and the final state of single ticks. */
#include "dahl_batch.h"
#include "models.h"
#include "plans.h"

enum { TICKS = 1000 };

static int32_t dcounts[TICKS];
static uint32_t load[TICKS];
static float F[TICKS];

static void slip_log(const any_plan_t *plan, any_state_t *state)
{
    dahl_batch_slip_counts(&plan->slip, &state->slip, dcounts, F, TICKS);
}

static void mix_log(const any_plan_t *plan, any_state_t *state)
{
    const dahl_part_t parts[] = {dahl_batch_part(&plan->parallel.plan[0], &state->parallel.state[0]), dahl_batch_slip_part(&plan->parallel.slip, &state->parallel.slip)};
    dahl_batch_parallel_counts(parts, 2, dcounts, F, TICKS);
}

#define BRISTLE_LOG(name, ...)                                                                                                 \
    static void name##_log(const any_plan_t *plan, any_state_t *state)                                                         \
    {                                                                                                                          \
        dahl_batch_##name##_counts(&plan->name, &state->dahl, dcounts, F, TICKS);                                              \
    }
DAHL_BRISTLE_MODELS(BRISTLE_LOG)

static void loaded_log(const any_plan_t *plan, any_state_t *state)
{
    dahl_batch_loaded_counts(&plan->dahl, &state->loaded, dcounts, load, F, TICKS);
}

#define LOG_ROW(name, ...) {#name, name##_prepare, name##_step, name##_log},
static const struct {
    const char *name;
    dahl_err_t (*prepare)(any_plan_t *, const set_t *);
    float (*step)(const any_plan_t *, any_state_t *, const set_t *, move_t);
    void (*log)(const any_plan_t *, any_state_t *);
} logs[] = {LOG_ROW(mix, 0) LOG_ROW(loaded, 0) LOG_ROW(slip, 0) DAHL_BRISTLE_MODELS(LOG_ROW)};

void setUp(void)
{
    motion_t m = MOTION_START;
    for (int t = 0; t < TICKS; t++) {
        dcounts[t] = (int32_t)(motion_random(&m) % 2001u) - 1000;
        load[t] = motion_random(&m) >> 1;
    }
}

static void test_each_model_has_the_bits_of_single_ticks(void)
{
    for (size_t i = 0; i < sizeof logs / sizeof logs[0]; i++) {
        const set_t set = {params_for(1e-3, 0.5f), logs[i].step == slip_step || logs[i].step == mix_step ? 3 : 0.6f};
        any_plan_t plan;
        any_state_t by_log, by_tick;
        memset(&by_log, 0, sizeof by_log);
        memset(&by_tick, 0, sizeof by_tick);
        TEST_ASSERT_EQUAL_INT_MESSAGE(DAHL_OK, logs[i].prepare(&plan, &set), logs[i].name);
        memset(F, 0xFF, sizeof F); /* NaN */
        logs[i].log(&plan, &by_log);
        for (int t = 0; t < TICKS; t++) {
            const move_t move = {dcounts[t], load[t]};
            TEST_ASSERT_TRUE_MESSAGE(F[t] == logs[i].step(&plan, &by_tick, &set, move), logs[i].name);
        }
        TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&by_tick, &by_log, sizeof by_tick, logs[i].name);
    }
}

static void test_work_and_tables_have_the_bits_of_single_ticks(void)
{
    static float by_speed[TICKS];
    const dahl_params_t params = params_for(1e-3, 0.5f);
    const dahl_plan_t plan = plan_for(&params);
    const dahl_velocity_params_t table = {.segment_bits = 4, .torque = {0.1f, -0.2f, [DAHL_VELOCITY_SEGMENTS - 1] = 0.4f}};
    dahl_velocity_plan_t over_speed;
    dahl_state_t by_log = {0}, by_tick = {0};
    dahl_work_t work = {{0}, {0}}, work_by_tick = {{0}, {0}};
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_velocity_prepare(&over_speed, &table));
    memset(F, 0xFF, sizeof F); /* NaN */
    memset(by_speed, 0xFF, sizeof by_speed);
    dahl_batch_work_counts(&plan, &by_log, &work, dcounts, F, TICKS);
    dahl_batch_velocity(&over_speed, dcounts, by_speed, TICKS);
    for (int t = 0; t < TICKS; t++) {
        TEST_ASSERT_TRUE(F[t] == dahl_work_step_counts(&plan, &by_tick, &work_by_tick, dcounts[t]));
        TEST_ASSERT_TRUE(by_speed[t] == dahl_velocity_torque(&over_speed, dcounts[t]));
    }
    TEST_ASSERT_EQUAL_MEMORY(&work_by_tick, &work, sizeof work);
}

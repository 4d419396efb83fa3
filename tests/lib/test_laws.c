/* SPDX-License-Identifier: MIT */
/* The contract of every model (laws.h) on the hard motions, and plans of zeros. Closed forms of loops and of dither follow from the bound of test_accuracy.c. */
#include "plans.h"
#define HOLDS(condition, words) TEST_ASSERT_TRUE_MESSAGE(condition, words)
#include "laws.h"
#include "loads.h"

#ifndef TEST_TICKS
#define TEST_TICKS 200000
#endif

enum { WALK = TEST_TICKS < 20000 ? 400 : 4000, TRAVELS = 5 };

static const double travels[TRAVELS] = {1e-7, 1e-4, 0.02, 0.7, 5.0};
static move_t walk[WALK];
static subject_t subject; /* static, because small cores have a small stack */

static set_t set_for(const model_t *model, double travel, float Fc)
{
    return (set_t){params_for(travel, Fc), more_for(model, 4, 0.4f, 0.3f)};
}

static void make_walk(motion_fn next, load_fn load)
{
    motion_t motion = MOTION_START, loading = MOTION_START;
    for (int t = 0; t < WALK; t++) {
        const move_t move = {next(&motion), load(&loading)};
        walk[t] = move;
    }
}

static void test_each_model_keeps_its_contract(void)
{
    for (size_t i = 0; i < (size_t)MODELS * MOTIONS * TRAVELS; i++) {
        const model_t *model = &models[i % MODELS];
        const set_t set = set_for(model, travels[i / MODELS % TRAVELS], 2.5f);
        make_walk(motions[i / MODELS / TRAVELS].next, loads[i % LOADS].next);
        TEST_ASSERT_TRUE_MESSAGE(subject_begin(&subject, model, &set), model->name);
        check_walk(&subject, walk, WALK);
        check_ends(&subject);
    }
}

static void test_plans_of_zeros_are_safe_on_any_bits(void)
{
    static const int32_t counts[] = {0, 1, -1, 8, -9, 1000, INT32_MAX, INT32_MIN};
    static const uint8_t words[] = {0x80, 0x7f, 0xff, 0xbf, 0x40, 0x55, 0x01};
    static const any_plan_t zeros;
    for (size_t i = 0; i < (size_t)MODELS * sizeof words; i++) {
        const model_t *model = &models[i % MODELS];
        const set_t set = set_for(model, 1e-3, 1.0f);
        any_state_t state, before;
        for (size_t k = 0; k < sizeof counts / sizeof counts[0]; k++) {
            const move_t move = {counts[k], ONE_Q30 / (uint32_t)(k + 1)};
            memset(&state, words[i / MODELS], sizeof state);
            for (int pass = 0; pass < 2; pass++) {
                state.loaded.load_q30 = LOAD_MOST;
                before = state;
                TEST_ASSERT_TRUE_MESSAGE(model->step(&zeros, &state, &set, move) == 0.0f || pass == 0, model->name);
            }
            state.loaded.load_q30 = LOAD_MOST;
            TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&before, &state, sizeof state, model->name);
            memset(&state, 0, sizeof state);
            TEST_ASSERT_TRUE_MESSAGE(model->step_q30 == NULL || model->step_q30(&zeros, &state, move) == 0, model->name);
        }
    }
}

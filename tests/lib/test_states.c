/* SPDX-License-Identifier: MIT */
/* Any bits are a safe state, and so are plans of zeros. All elements move in random order, with several plans, on one memory
 * whose bits are spoiled now and then. test_step_laws.c sets torques and changes plans; test_part_laws.c has work and
 * inverse. */
#include "../random.h"
#include "models.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 200000
#endif
#define HOLDS(condition, words) TEST_ASSERT_TRUE_MESSAGE(condition, words)

enum { CALLS = 2 * TEST_TICKS, SETS = 4 };

typedef struct {
    const model_t *model;
    set_t set;
    any_plan_t plan;
} element_t;

static element_t element; /* each call prepares them again, because small cores have little memory */
static any_state_t state;
static uint64_t seed;

static uint64_t random64(void)
{
    const uint64_t high = random_u32(&seed);
    return high << 32 | random_u32(&seed);
}

static uint32_t random_below(uint32_t n)
{
    return (uint32_t)((random64() >> 32) * n >> 32);
}

static int32_t random_counts(void)
{
    int32_t any = (int32_t)(uint32_t)random64();
    return random_below(3) != 0 ? any % 12 : any >> random_below(32);
}

static uint32_t random_load(void)
{
    uint32_t any = (uint32_t)random64(), kind = random_below(8);
    return kind == 0 ? 0 : kind < 3 ? ONE_Q30 : any >> random_below(4);
}

static void prepare(element_t *e, const model_t *model)
{
    static const double travels[SETS] = {1e-6, 2e-3, 0.3, 9.0};
    static const float more[SETS] = {0.25f, 0.9f, 1.0f, 4.0f}, b[SETS] = {0.1f, 0.5f, 0.9f, 0.99f};
    static const float Fc[SETS] = {1.0f, 0.371f, 1e-3f, 3e4f};
    const uint32_t k = random_below(SETS);
    e->model = model;
    e->set.p = params_for(travels[k], Fc[k]);
    e->set.more = more_for(model, (float)(1 + k), more[k], b[k]);
    HOLDS(model->prepare(&e->plan, &e->set) == DAHL_OK, model->name);
}

/* Flip one bit, replace all bits, set words to the ends of their type, or w to an end of its range or next to it. */
static void spoil(void)
{
    const int64_t past = ((int64_t)1 << 62) + ((int64_t)1 << 31), end = past - 1 + (int64_t)random_below(3);
    uint32_t words[sizeof state / sizeof(uint32_t)];
    const uint32_t kind = random_below(4);
    memcpy(words, &state, sizeof words);
    if (kind == 3) {
        state.dahl.w = random_below(2) ? end : -end;
        return;
    }
    if (kind == 0) {
        words[random_below(sizeof words / sizeof words[0])] ^= UINT32_C(1) << random_below(32);
    }
    for (size_t i = 0; kind != 0 && i < sizeof words / sizeof words[0]; i++) {
        words[i] = kind == 1 ? (uint32_t)random64() : 0x80000000u - random_below(2);
    }
    memcpy(&state, words, sizeof words);
}

static void check_limits(const element_t *e, move_t move, float F)
{
    const long double c = e->model->has_load ? load_in_range(move) * 0x1p-30L : 1;
    const long double slack = e->model->ulps * ulp_now(e->model, &e->set, move);
    long double forward = c * whole_of(e->model, &e->set), backward = forward;
    if (e->model->more == MORE_IS_RATIO) {
        forward = e->set.p.Fc;
        backward = asymmetric_params(&e->set).Fc_backward;
    }
    HOLDS(F <= forward + slack && F >= -backward - slack, "the torque stays within the limits of the element");
    HOLDS(e->model->step != dahl_model_step || fabsf(F) <= e->set.p.Fc, "the torque stays within Fc to the bit");
}

static void check_q30(const element_t *e, any_state_t before, move_t move, float F)
{
    const long double whole = whole_of(e->model, &e->set);
    if (e->model->step_q30 == NULL) {
        return;
    }
    const int32_t q30 = e->model->step_q30(&e->plan, &before, move);
    const long double slack = e->model->q30_error * whole + e->model->ulps * ulp_now(e->model, &e->set, move);
    HOLDS(fabsl(q30 * (long double)DAHL_Q30 * whole - F) <= slack, "both forms agree");
    HOLDS(load_in_range(move) > ONE_Q30 || (q30 <= (int32_t)ONE_Q30 && q30 >= -(int32_t)ONE_Q30), "a ratio is at most 2^30");
    HOLDS(memcmp(&before, &state, sizeof state) == 0, "both forms leave the same state");
}

/* The same result as after a rest under the load before. */
static void check_clamped_first(const element_t *e, any_state_t before, move_t move, float F)
{
    const move_t rest = {0, e->model->has_load == 1 ? before.loaded.load_q30 : move.load_q30};
    (void)e->model->step(&e->plan, &before, &e->set, rest);
    HOLDS(e->model->step(&e->plan, &before, &e->set, move) == F, "a call clamps the state first");
    HOLDS(memcmp(&before, &state, sizeof state) == 0, "a call clamps the state first");
}

static int is_in_range(int64_t w)
{
    const int64_t end = ((int64_t)1 << 62) + ((int64_t)1 << 31);
    return -end <= w && w < end;
}

static void step_any_element(void)
{
    const element_t *e = &element;
    prepare(&element, &models[random_below(MODELS)]);
    const move_t move = {random_counts(), random_load()}, rest = {0, move.load_q30};
    const any_state_t before = state;
    any_state_t at_rest = state;
    HOLDS(dahl_state_ok(&before.dahl) == is_in_range(before.dahl.w), "dahl_state_ok() is the range to the bit");
    const float F0 = e->model->step(&e->plan, &at_rest, &e->set, rest), F = e->model->step(&e->plan, &state, &e->set, move);
    check_limits(e, move, F0);
    check_limits(e, move, F);
    HOLDS(move.counts > 0 ? F >= F0 : move.counts < 0 ? F <= F0 : F == F0, "the torque follows the direction of the move");
    check_q30(e, before, move, F);
    check_clamped_first(e, before, move, F);
    const any_state_t after = state;
    HOLDS(e->model->step(&e->plan, &state, &e->set, rest) == F, "0 counts keep the torque");
    HOLDS(memcmp(&after, &state, sizeof state) == 0, "a call leaves a state in range");
    HOLDS(e->model->prepare != dahl_model_prepare || dahl_state_ok(&state.dahl), "dahl_state_ok() accepts it");
}

static void test_calls_in_any_order_are_safe_on_any_bits(void)
{
    seed = 1;
    for (int i = 0; i < CALLS; i++) {
        if (random_below(6) < 2) {
            spoil();
        } else {
            step_any_element();
        }
    }
}

static void test_plans_of_zeros_are_safe_on_any_bits(void)
{
    static const int32_t counts[] = {0, 1, -1, 8, -9, 1000, INT32_MAX, INT32_MIN};
    static const uint8_t words[] = {0x80, 0x7f, 0xff, 0xbf, 0x40, 0x55, 0x01};
    static const any_plan_t zeros;
    for (size_t i = 0; i < (size_t)MODELS * sizeof words; i++) {
        const model_t *model = &models[i % MODELS];
        const set_t set = {params_for(1e-3, 1.0f), more_for(model, 4, 0.4f, 0.3f)};
        any_state_t bits, before;
        for (size_t k = 0; k < sizeof counts / sizeof counts[0]; k++) {
            const move_t move = {counts[k], ONE_Q30 / (uint32_t)(k + 1)};
            memset(&bits, words[i / MODELS], sizeof bits);
            for (int pass = 0; pass < 2; pass++) {
                bits.loaded.load_q30 = LOAD_MOST;
                before = bits;
                TEST_ASSERT_TRUE_MESSAGE(model->step(&zeros, &bits, &set, move) == 0.0f || pass == 0, model->name);
            }
            bits.loaded.load_q30 = LOAD_MOST;
            TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&before, &bits, sizeof bits, model->name);
            memset(&bits, 0, sizeof bits);
            TEST_ASSERT_TRUE_MESSAGE(model->step_q30 == NULL || model->step_q30(&zeros, &bits, move) == 0, model->name);
        }
    }
}

static void test_a_plan_of_zeros_keeps_no_torque(void)
{
    static const dahl_plan_t zeros;
    static const dahl_velocity_plan_t no_table;
    const dahl_params_t params = params_for(1e-3, 1.0f);
    const dahl_plan_t plan = plan_for(&params);
    const dahl_plan_t *const changes[][2] = {{&zeros, &plan}, {&plan, &zeros}, {&zeros, &zeros}};
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; i++) {
        dahl_state_t bristle = {i % 2 ? INT64_MAX : INT64_MIN};
        dahl_change_plan(changes[i][0], changes[i][1], &bristle);
        TEST_ASSERT_TRUE(bristle.w == 0);
        dahl_set_torque(&zeros, &bristle, 0.25f);
        TEST_ASSERT_TRUE(dahl_torque(&zeros, &bristle) == 0.0f && dahl_tip_torque(&zeros, 1000) == 0.0f);
    }
    TEST_ASSERT_TRUE(dahl_velocity_torque(&no_table, 1000) == 0.0f && dahl_velocity_torque(&no_table, INT32_MIN) == 0.0f);
}

/* NaN and subnormal angles keep the state, an infinite angle saturates, a load of 0 clears any state. */
static void test_the_clamped_model_keeps_its_limits_for_any_input(void)
{
    dahl_params_t p = params_for(0.01, 2.0f), soft = {0x1p-64f, 0x1p63f, 0.0f};
    dahl_plan_t plan = plan_for(&p), soft_plan = plan_for(&soft);
    dahl_state_t bristle = {0}, little = {1};
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &bristle, INFINITY, ONE_Q30 / 2) == 1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &bristle, -INFINITY, ONE_Q30 / 2) == -1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &bristle, NAN, ONE_Q30 / 2) == -1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &bristle, 1e-45f, ONE_Q30 / 2) == -1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &bristle, INFINITY, 0) == 0.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&soft_plan, &bristle, -INFINITY, ONE_Q30) == -soft.Fc);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &little, 0.0f, 0) == 0.0f && little.w == 0);
}

/* SPDX-License-Identifier: MIT */
/* The properties of the fuzzer of elements, checked with random input: the contract of each from rest and from any bits,
 * return-point memory, no creep below breakaway, the integral of the work, the inverse, tips, and loads of 1. Plans of zeros. */
#include <unity.h>

#include "../fuzz/parts.c"

#ifndef TEST_TICKS
#define TEST_TICKS 200000
#endif

static const dahl_params_t params = {2.5f, 1.0f, 4e-4f};

static void test_the_laws_of_parts_hold_for_random_input(void)
{
    fuzz_at_random(TEST_TICKS / 10, 128);
}

static void test_plans_of_zeros_are_safe_on_any_bits(void)
{
    static const int32_t counts[] = {0, 1, -1, 8, -9, 1000, INT32_MAX, INT32_MIN};
    static const uint8_t words[] = {0x80, 0x7f, 0xff, 0xbf, 0x40, 0x55, 0x01};
    static const any_plan_t zeros;
    for (size_t i = 0; i < (size_t)MODELS * sizeof words; i++) {
        const model_t *model = &models[i % MODELS];
        const set_t set = {params, more_for(model, 4, 0.4f, 0.3f)};
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
    dahl_plan_t plan;
    const dahl_plan_t *const changes[][2] = {{&zeros, &plan}, {&plan, &zeros}, {&zeros, &zeros}};
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_prepare(&plan, &params));
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
    const dahl_params_t double_Fc = {params.sigma0, 2.0f, 0.0f}, soft = {0x1p-64f, 0x1p63f, 0.0f};
    dahl_plan_t plan, soft_plan;
    dahl_state_t bristle = {0}, little = {1};
    TEST_ASSERT_TRUE(dahl_prepare(&plan, &double_Fc) == DAHL_OK && dahl_prepare(&soft_plan, &soft) == DAHL_OK);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &bristle, INFINITY, ONE_Q30 / 2) == 1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &bristle, -INFINITY, ONE_Q30 / 2) == -1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &bristle, NAN, ONE_Q30 / 2) == -1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &bristle, 1e-45f, ONE_Q30 / 2) == -1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &bristle, INFINITY, 0) == 0.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&soft_plan, &bristle, -INFINITY, ONE_Q30) == -soft.Fc);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &little, 0.0f, 0) == 0.0f && little.w == 0);
}

/* The condition of the bound: u/c is 0 or at least 2^-30. */
static void test_the_clamped_model_keeps_its_bound_down_to_the_least_travel(void)
{
    static const uint32_t loads[] = {ONE_Q30 / 1024, ONE_Q30 / 3, ONE_Q30, 0x7fffffffu};
    const dahl_params_t p = {1.9999f, 1.9999f, 0.0f}; /* u = dtheta */
    dahl_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_prepare(&plan, &p));
    for (size_t i = 0; i < 8; i++) {
        const long double c = loads[i / 2] * 0x1p-30L, ulp = fmaxl(ulp_of(p.Fc), ulp_of((float)(c * p.Fc)));
        const float least = (float)(c * 0x1.0001p-30L), far = (float)(18 * c);
        dahl_state_t state = {0};
        reference_t exact = {1 / c, 0, c};
        for (int32_t tick = 0; tick < 300000; tick++) {
            const float dtheta = tick == 0 ? far : i % 2 && tick % 3 == 2 ? -least : least;
            const float F = dahl_clamped_step(&plan, &state, dtheta, loads[i / 2]);
            TEST_ASSERT_TRUE(fabsl(F - reference_move(&exact, dtheta) * p.Fc) <= DAHL_ULP_ANGLE * ulp);
        }
    }
}

/* Why there is a condition: 2^14 moves of 2^-44 are lost, their sum is not. */
static void test_moves_below_the_least_travel_must_be_added_up(void)
{
    const dahl_params_t p = {1.0f, 1.0f, 0.0f};
    dahl_plan_t plan;
    dahl_state_t state = {0};
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_prepare(&plan, &p));
    (void)dahl_clamped_step(&plan, &state, 14.0f, ONE_Q30);
    const int64_t before = state.w;
    for (int tick = 0; tick < 1 << 14; tick++) {
        (void)dahl_clamped_step(&plan, &state, 0x1p-44f, ONE_Q30);
    }
    TEST_ASSERT_TRUE(state.w == before);
    (void)dahl_clamped_step(&plan, &state, 0x1p-30f, ONE_Q30);
    TEST_ASSERT_TRUE(state.w > before);
}

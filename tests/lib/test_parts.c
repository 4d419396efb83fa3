/* SPDX-License-Identifier: MIT */
/* Properties of single models: a load of 1, and the ends of the ranges of loads, torques and breakaways. test_part_laws.c has
 * no creep below breakaway. */
#include "models.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif

enum { LAW_TICKS = TEST_TICKS < 20000 ? TEST_TICKS : 100000 };

/* Half the load gives exactly half the torque if Fc and sigma0 both follow the load. */
static void test_a_load_of_1_has_the_bits_of_the_plain_element(void)
{
    dahl_params_t p = params_for(0.01, 1.7f);
    dahl_plan_t plan = plan_for(&p);
    dahl_loaded_state_t state = {{0}, 0}, half = {{0}, 0}, q30 = {{0}, 0};
    dahl_state_t plain = {0}, plain_q30 = {0}, clamped = {0}, by_angle = {0};
    motion_t m = MOTION_START;
    for (int t = 0; t < LAW_TICKS; t++) {
        const int32_t d = motion_leap(&m) >> (t % 20);
        const float F = dahl_step_counts(&plan, &plain, d);
        TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &state, d, ONE_Q30) == F);
        TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &half, d, ONE_Q30 / 2) == F / 2);
        int32_t q = dahl_step_counts_q30(&plan, &plain_q30, d);
        int32_t rounded = (int32_t)(((int64_t)q + 1 + ((int64_t)1 << 31)) / 2 - ((int64_t)1 << 30)); /* q/2, half up */
        TEST_ASSERT_EQUAL_INT32(rounded, dahl_loaded_step_counts_q30(&plan, &q30, d, ONE_Q30 / 2));
        uint32_t bits = motion_random(&m);
        float any, dtheta = (float)d * THETA * 1e-6f;
        memcpy(&any, &bits, sizeof any);
        dtheta = t % 3 != 0 ? dtheta : any;
        TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &clamped, dtheta, ONE_Q30) == dahl_step(&plan, &by_angle, dtheta));
        TEST_ASSERT_TRUE(clamped.w == by_angle.w);
    }
}

static void test_a_load_above_the_range_is_the_largest_load(void)
{
    const dahl_params_t p = {100.0f, 2.0f, 1e-3f};
    const dahl_plan_t plan = plan_for(&p);
    dahl_loaded_state_t loaded = {{0}, 0};
    (void)dahl_loaded_step_counts_q30(&plan, &loaded, INT32_MAX, UINT32_MAX);
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, dahl_loaded_step_counts_q30(&plan, &loaded, 1, UINT32_MAX));
    TEST_ASSERT_EQUAL_INT32(-INT32_MAX, dahl_loaded_step_counts_q30(&plan, &loaded, INT32_MIN, 0x80000000u));
}

/* Torques below the normal floats are 0; all others are rounded correctly. */
static void test_the_least_torques_of_a_loaded_element(void)
{
    dahl_params_t p = {0x1p-60f, 0x1p-64f, 0x1p-10f};
    dahl_plan_t plan = plan_for(&p);
    motion_t m = MOTION_START;
    for (int i = 0; i < LAW_TICKS; i++) {
        uint32_t load = (motion_random(&m) >> (motion_random(&m) % 32u) >> 1) | 1;
        dahl_loaded_state_t state = {{(int64_t)(motion_random(&m) | 1) << 30 >> (motion_random(&m) % 62u)}, load};
        dahl_loaded_state_t mirrored = {{-state.bristle.w}, load};
        long double c_Fc = p.Fc * (load * 0x1p-30L), F = ldexpl(state.bristle.w, -62) * c_Fc;
        float got = dahl_loaded_step_counts(&plan, &state, 0, load);
        TEST_ASSERT_TRUE(fabsl(got - F) <= 0.512L * c_Fc * 0x1p-23L && (got == 0.0f || got >= 0x1p-126f));
        TEST_ASSERT_TRUE((got == 0.0f) == (F == 0 || (c_Fc < 0x1p-64L && F < 0x1p-32L * c_Fc)));
        TEST_ASSERT_TRUE(dahl_loaded_step_counts(&plan, &mirrored, 0, load) == -got);
        TEST_ASSERT_TRUE(got == 0.0f || fabsl(got - F) <= 0x1p-24L * 1.02L * F);
    }
}

/* NaN and subnormal angles keep the state, an infinite angle saturates, a load of 0 clears any state. */
static void test_the_clamped_model_keeps_its_limits_for_any_input(void)
{
    dahl_params_t p = params_for(0.01, 2.0f), soft = {0x1p-64f, 0x1p63f, 0.0f};
    dahl_plan_t plan = plan_for(&p), soft_plan = plan_for(&soft);
    dahl_state_t state = {0}, little = {1};
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, INFINITY, ONE_Q30 / 2) == 1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, -INFINITY, ONE_Q30 / 2) == -1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, NAN, ONE_Q30 / 2) == -1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, 1e-45f, ONE_Q30 / 2) == -1.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &state, INFINITY, 0) == 0.0f);
    TEST_ASSERT_TRUE(dahl_clamped_step(&soft_plan, &state, -INFINITY, ONE_Q30) == -soft.Fc);
    TEST_ASSERT_TRUE(dahl_clamped_step(&plan, &little, 0.0f, 0) == 0.0f && little.w == 0);
}

static void test_breakaways_and_travels_at_the_ends_of_their_ranges(void)
{
    static const float breakaways[] = {1e-45f, 1e-10f, 0x1p-31f, 0x1.fffffep-1f, 0x1.fffffcp-1f};
    static const double travels[] = {1.0 / (1 << 29), 1e-3, 1.0, 1.999999, 2.0, 2.000001, 63.9, 64.1, 1e6};
    const model_t *model = model_named("elastoplastic");
    for (size_t i = 0; i < 2 * 5 * 9; i++) {
        const set_t set = {params_for(travels[i / 10], 1.0f), breakaways[i % 5]};
        motion_t motion = MOTION_START;
        any_plan_t plan;
        any_state_t state = {{0}}, q30 = {{0}};
        exact_t exact;
        TEST_ASSERT_EQUAL_INT(DAHL_OK, breakaway_prepare(&plan, &set));
        exact_begin(&exact, model, &set);
        for (int t = 0; t < 3000; t++) {
            const move_t move = {i % 10 < 5 ? motion_leap(&motion) : motion_two_one(&motion), 0};
            const long double w = model->exact(&exact, move);
            TEST_ASSERT_TRUE(fabsl(model->step(&plan, &state, &set, move) - w) <= DAHL_ULP_PARTS * ulp_of(1.0f));
            TEST_ASSERT_TRUE(fabsl(model->step_q30(&plan, &q30, move) * (long double)DAHL_Q30 - w) <= DAHL_ELASTOPLASTIC_ERROR_Q30);
        }
    }
}

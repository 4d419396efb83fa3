/* SPDX-License-Identifier: MIT */
/* simulators: friction_move() and friction_move_q30() of each model agree, also for moves that no int32_t holds, and reach the Fc of
 * each direction. FMUs use the first call, MuJoCo the second, and tests in Python compare both with the library. */
#include <math.h>
#include <unity.h>

#include "random.h"
#include "simulators/friction.h"

static const float Fcs[2][3] = {{0.2f, 0.7f, 0.05f}, {0.7f, 0.2f, 0.05f}};
static uint64_t seed;

void setUp(void)
{
    seed = 9;
}

static friction_t prepared(uint32_t model, int order, float theta_per_count)
{
    const friction_model_t *row = &friction_models[model];
    const dahl_model_q30_t *calls = row->calls->q30;
    friction_t f = {.model = model, .params = {.each = {.theta_per_count = theta_per_count}, .slips = order == 0 ? 5u : 0u, .own = model == FRICTION_STRIBECK ? 0.004f : 0.6f}};
    f.params.each.elements = calls->Fcs != 0 ? calls->Fcs : 3;
    for (uint32_t k = 0; k < f.params.each.elements; k++) {
        f.params.each.Fc[k] = Fcs[order][k];
        f.params.each.sigma0[k] = k == 0 || calls->sigma0s != 1 ? 100.0f / (float)(1 + k) : 0.0f;
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(DAHL_OK, friction_prepare(&f), row->name);
    return f;
}

/* Of either sign, up to 2^40 */
static double random_counts(void)
{
    const double size = (double)(((uint64_t)random_u32(&seed) << 8) >> random_u32(&seed) % 40);
    return random_u32(&seed) % 2 ? size : -size;
}

static void test_both_calls_of_each_model_return_the_same_torque(void)
{
    for (uint32_t i = 0; i < 4 * FRICTION_MODELS; i++) {
        const friction_t f = prepared(i / 4, i % 2, i % 4 < 2 ? 4e-4f : 1e-8f);
        friction_state_t one = {.word = {0}}, other = {.word = {0}};
        for (int tick = 0; tick < 500; tick++) {
            const double counts = random_counts(), load = random_u32(&seed) * 0x1.ffp-32;
            const double F = (double)friction_move(&f, &one, counts, load);
            TEST_ASSERT_DOUBLE_WITHIN(1e-7 * f.Fc, F, friction_move_q30(&f, &other, counts, load) * 0x1p-30 * f.Fc);
        }
        TEST_ASSERT_EQUAL_MEMORY(&one, &other, sizeof one);
    }
}

static void test_a_long_move_reaches_the_Fc_of_its_direction(void)
{
    for (uint32_t i = 0; i < 4 * FRICTION_MODELS; i++) {
        const friction_t f = prepared(i / 4, i % 2, i % 4 < 2 ? 4e-4f : 1.6e-11f);
        const float *Fc = f.params.each.Fc;
        const uint32_t Fcs_of_model = friction_models[f.model].calls->q30->Fcs;
        const bool is_stribeck = f.model == FRICTION_STRIBECK; /* this move is fast: Fc in both directions */
        friction_state_t state = {.word = {0}};
        double forward = 0;
        for (uint32_t k = 0; k < f.params.each.elements; k++) {
            forward += (double)Fc[k];
        }
        const double backward = Fcs_of_model == 2 ? (double)Fc[1] : forward;
        forward = is_stribeck ? backward : Fcs_of_model == 2 ? (double)Fc[0] : forward;
        TEST_ASSERT_DOUBLE_WITHIN(1e-7, forward, (double)friction_move(&f, &state, 1e300, 1.0));
        TEST_ASSERT_DOUBLE_WITHIN(1e-7, -backward, friction_move_q30(&f, &state, -0x1p35, 1.0) * 0x1p-30 * f.Fc);
        TEST_ASSERT_DOUBLE_WITHIN(1e-7, forward, friction_move_q30(&f, &state, (double)INFINITY, 1.0) * 0x1p-30 * f.Fc);
    }
}

static void test_a_model_without_a_count_gets_2e_20_of_its_least_presliding_length(void)
{
    for (uint32_t model = 0; model < FRICTION_MODELS; model++) {
        const dahl_model_q30_t *calls = friction_models[model].calls->q30;
        const friction_t f = prepared(model, calls->Fcs == 2, 0.0f);
        const float length = calls->sigma0s == 0 ? 0.05f * 3 / 100 : 0.2f / 100; /* 0.05 N m at 100/3 N m/rad, or 0.2 at 100 */
        TEST_ASSERT_FLOAT_WITHIN(1e-12f, model == FRICTION_DAHL ? 0 : length * 0x1p-20f, f.params.each.theta_per_count);
    }
}

static void test_a_position_is_the_nearest_count_or_the_angle_itself(void)
{
    friction_t f = prepared(FRICTION_DAHL, 0, 0x1p-10f);
    static const double counts[][2] = {{2.5, 2}, {3.5, 4}, {-2.5, -2}, {-0.7, -1}, {0x1p40 + 0.6, 0x1p40 + 1}, {0x1p52 + 1, 0x1p52 + 1},
                                       {-0x1p52 - 1, -0x1p52 - 1}};
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; i++) {
        TEST_ASSERT_TRUE(friction_position(&f, counts[i][0] * 0x1p-10) == counts[i][1]);
    }
    f = prepared(FRICTION_DAHL, 0, 0.0f);
    TEST_ASSERT_TRUE(friction_position(&f, 2.5) == 2.5);
}

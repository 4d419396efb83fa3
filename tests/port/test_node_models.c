/* SPDX-License-Identifier: MIT */
/* A node that answers by another model than Dahl's: the bits of the library, or for a mix the sum of its parts; what a client is
 * told; a restart; bad parameters. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "ask_node.h"
#include "dahl_node.h"

static const dahl_params_t bearing = {100.0f, 0.5f, 1e-4f};
static const dahl_asymmetric_params_t preloaded = {100.0f, 0.3f, 0.5f, 1e-4f};
static const dahl_node_parallel_params_t mix = {4, 0x6u, 1e-4f, {100.0f, 60.0f, 40.0f, 200.0f}, {0.25f, 0.5f, 1.0f, 0.3f}};
static const dahl_slip_params_t springs = {3, 1e-4f, {100.0f, 60.0f, 40.0f}, {0.25f, 0.5f, 1.0f}};
static dahl_node_t node;
static dahl_node_slip_t slipping;
static dahl_node_asymmetric_t asymmetric;
static dahl_node_elastoplastic_t elastoplastic;
static dahl_node_parallel_t parallel;
static dahl_node_loaded_t loaded;
static dahl_friction_torque_t torque;
static uint32_t now_us, counter;
static int32_t place;

void setUp(void)
{
    now_us = 0;
    counter = 0;
    place = 0;
    memset(&slipping, 0x25, sizeof slipping); /* as left by a use before */
    memset(&asymmetric, 0x25, sizeof asymmetric);
    memset(&elastoplastic, 0x25, sizeof elastoplastic);
    memset(&loaded, 0x25, sizeof loaded);
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_init(&node, &bearing, 3));
}

void tearDown(void) {}

/* The ratio that is answered after a move. */
static int32_t moved(int32_t dcounts)
{
    dahl_encoder_state_t seen = {.valid = 1};
    dahl_can_frame_t in, out;
    place += dcounts;
    seen.count = place;
    seen.counter = (uint8_t)(counter++ & 15u);
    dahl_frames_pack_encoder(&in, 3, &seen);
    now_us += 1000;
    TEST_ASSERT_TRUE(dahl_node_receive(&node, &in, now_us, &out));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_GOOD, dahl_frames_unpack_torque(&out, &torque));
    return torque.torque_q30;
}

static int32_t move_at(uint32_t i)
{
    return (int32_t)(i * i % 401u) - 200;
}

static dahl_param_reply_t ask(uint8_t param, uint8_t write)
{
    return ask_node(&node, now_us, param, write, 1u << 19);
}

static void check_told(uint32_t kind, uint32_t sigma0_q10, uint32_t Fc_q20)
{
    TEST_ASSERT_EQUAL_UINT32(kind, ask(DAHL_FRAMES_PARAM_MODEL, DAHL_FRAMES_PARAM_READ).value);
    TEST_ASSERT_EQUAL_UINT32(sigma0_q10, ask(DAHL_FRAMES_PARAM_SIGMA0, DAHL_FRAMES_PARAM_READ).value);
    TEST_ASSERT_EQUAL_UINT32(Fc_q20, ask(DAHL_FRAMES_PARAM_FC, DAHL_FRAMES_PARAM_READ).value);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_OUT_OF_RANGE, ask(DAHL_FRAMES_PARAM_FC, DAHL_FRAMES_PARAM_WRITE).result);
    TEST_ASSERT_EQUAL_UINT32(Fc_q20, ask(DAHL_FRAMES_PARAM_FC, DAHL_FRAMES_PARAM_READ).value);
}

static void check_restart_relaxes(void)
{
    const dahl_node_reset_t restart = {.what = DAHL_FRAMES_RESET_RESTART};
    dahl_can_frame_t in, out;
    TEST_ASSERT_TRUE(moved(100000) > 1 << 29);
    dahl_frames_pack_reset(&in, 3, &restart);
    TEST_ASSERT_TRUE(dahl_node_receive(&node, &in, now_us, &out));
    TEST_ASSERT_EQUAL_INT32(0, moved(0));
}

/* Neither a sum of elements nor the model can be set over the bus. */
static void check_not_written(void)
{
    for (uint8_t param = DAHL_FRAMES_PARAM_SIGMA0; param <= DAHL_FRAMES_PARAM_THETA; param++) {
        uint32_t before = ask(param, DAHL_FRAMES_PARAM_READ).value;
        TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_OUT_OF_RANGE, ask(param, DAHL_FRAMES_PARAM_WRITE).result);
        TEST_ASSERT_EQUAL(before, ask(param, DAHL_FRAMES_PARAM_HOLD).value);
    }
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_OUT_OF_RANGE,
                      ask_node(&node, now_us, DAHL_FRAMES_PARAM_MODEL, DAHL_FRAMES_PARAM_WRITE, 0).result);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_OUT_OF_RANGE, ask(DAHL_FRAMES_PARAM_MODEL, DAHL_FRAMES_PARAM_HOLD).result);
}

static void test_slip_answers_are_the_librarys(void)
{
    dahl_slip_plan_t plan;
    dahl_slip_state_t state = {{0}};
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_slip_prepare(&plan, &springs));
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_use_slip(&node, &slipping, &springs));
    TEST_ASSERT_EQUAL_INT32(0, moved(0));
    for (uint32_t i = 1; i < 3000; i++) {
        TEST_ASSERT_EQUAL_INT32(dahl_slip_step_counts_q30(&plan, &state, move_at(i)), moved(move_at(i)));
    }
    TEST_ASSERT_EQUAL_MEMORY(&state, &slipping.state, sizeof state);
    check_told(DAHL_FRAMES_MODEL_SLIP + 3, 200u << 10, 7u << 18);
    TEST_ASSERT_EQUAL((uint32_t)(1e-4f * 0x1p38f), ask(DAHL_FRAMES_PARAM_THETA, DAHL_FRAMES_PARAM_READ).value);
    check_not_written();
    check_restart_relaxes();
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_init(&node, &bearing, 3));
    TEST_ASSERT_EQUAL(0, ask(DAHL_FRAMES_PARAM_MODEL, DAHL_FRAMES_PARAM_READ).value);
}

static void test_asymmetric_answers_are_the_librarys(void)
{
    dahl_asymmetric_plan_t plan;
    dahl_state_t state = {0};
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_asymmetric_prepare(&plan, &preloaded));
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_use_asymmetric(&node, &asymmetric, &preloaded));
    TEST_ASSERT_EQUAL_INT32(0, moved(0));
    for (uint32_t i = 1; i < 3000; i++) {
        TEST_ASSERT_EQUAL_INT32(dahl_asymmetric_step_counts_q30(&plan, &state, move_at(i)), moved(move_at(i)));
    }
    check_told(DAHL_FRAMES_MODEL_ASYMMETRIC, 100u << 10, 1u << 19);
    check_restart_relaxes();
}

static void test_elastoplastic_answers_are_the_librarys(void)
{
    dahl_elastoplastic_plan_t plan;
    dahl_state_t state = {0};
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_elastoplastic_prepare(&plan, &bearing, 0.7f));
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_use_elastoplastic(&node, &elastoplastic, &bearing, 0.7f));
    TEST_ASSERT_EQUAL_INT32(0, moved(0));
    for (uint32_t i = 1; i < 3000; i++) {
        TEST_ASSERT_EQUAL_INT32(dahl_elastoplastic_step_counts_q30(&plan, &state, move_at(i)), moved(move_at(i)));
    }
    check_told(DAHL_FRAMES_MODEL_ELASTOPLASTIC, 100u << 10, 1u << 19);
    check_restart_relaxes();
}

static dahl_param_reply_t carry(uint32_t load)
{
    const dahl_param_write_t asked = {.param = DAHL_FRAMES_PARAM_LOAD, .write = DAHL_FRAMES_PARAM_WRITE, .value = load};
    dahl_param_reply_t reply;
    dahl_can_frame_t in, out;
    dahl_frames_pack_param_write(&in, 3, &asked);
    TEST_ASSERT_TRUE(dahl_node_receive(&node, &in, now_us, &out));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_GOOD, dahl_frames_unpack_param_reply(&out, &reply));
    return reply;
}

static void test_loaded_answers_are_the_librarys(void)
{
    dahl_plan_t plan;
    dahl_loaded_state_t state = {{0}, 0};
    uint32_t load = DAHL_NODE_ONE;
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_prepare(&plan, &bearing));
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_use_loaded(&node, &loaded, &bearing));
    TEST_ASSERT_EQUAL_INT32(0, moved(0));
    for (uint32_t i = 1; i < 3000; i++) {
        if (i % 7 == 0) {
            load = i * 7919u % (DAHL_NODE_ONE + 1);
            TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_DONE, carry(load).result);
        }
        TEST_ASSERT_EQUAL_INT32(dahl_loaded_step_counts_q30(&plan, &state, move_at(i), load << 14), moved(move_at(i)));
    }
    carry(DAHL_NODE_ONE);
    check_told(DAHL_FRAMES_MODEL_LOADED, 100u << 10, 1u << 19);
    carry(3 * (DAHL_NODE_ONE / 4));
    check_restart_relaxes();
    TEST_ASSERT_EQUAL_UINT32(3 * (DAHL_NODE_ONE / 4), ask(DAHL_FRAMES_PARAM_LOAD, DAHL_FRAMES_PARAM_READ).value);
    TEST_ASSERT_EQUAL_INT32(3 * (1 << 28), moved(1 << 28));
}

static void test_a_load_is_of_the_model_that_follows_one(void)
{
    dahl_param_reply_t reply = carry(1);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_OUT_OF_RANGE, reply.result);
    TEST_ASSERT_EQUAL_UINT32(DAHL_NODE_ONE, reply.value);
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_use_elastoplastic(&node, &elastoplastic, &bearing, 0.7f));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_OUT_OF_RANGE, carry(1).result);
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_use_loaded(&node, &loaded, &bearing));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_DONE, carry(0).result);
    reply = carry(DAHL_NODE_ONE + 1);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_OUT_OF_RANGE, reply.result);
    TEST_ASSERT_EQUAL_UINT32(0, reply.value);
    moved(0);
    TEST_ASSERT_EQUAL_INT32(0, moved(1 << 28));
    carry(DAHL_NODE_ONE);
    TEST_ASSERT_EQUAL_INT32(0, moved(0)); /* without load it relaxed */
}

/* Against the sum in double of each element's own torque. */
static void check_mix(const dahl_node_parallel_params_t *params)
{
    dahl_plan_t plans[8];
    dahl_slip_plan_t slips[8];
    dahl_state_t states[8] = {{0}};
    dahl_slip_state_t slip_states[8] = {{{0}}};
    double sum = 0;
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_use_parallel(&node, &parallel, params));
    for (uint32_t k = 0; k < params->elements; k++) {
        dahl_params_t one = {params->sigma0[k], params->Fc[k], params->theta_per_count};
        dahl_slip_params_t slip = {1, params->theta_per_count, {params->sigma0[k]}, {params->Fc[k]}};
        TEST_ASSERT_EQUAL(DAHL_OK, dahl_prepare(&plans[k], &one));
        TEST_ASSERT_EQUAL(DAHL_OK, dahl_slip_prepare(&slips[k], &slip));
        sum += (double)params->Fc[k];
    }
    TEST_ASSERT_EQUAL_INT32(0, moved(0));
    for (uint32_t i = 1; i < 3000; i++) {
        double F = 0;
        for (uint32_t k = 0; k < params->elements; k++) {
            int64_t w = (params->slips >> k & 1u) != 0 ? dahl_slip_part_move(&slips[k], &slip_states[k], move_at(i))
                                                       : dahl_part_move(&plans[k], &states[k], move_at(i));
            F += (double)params->Fc[k] * (double)w;
        }
        TEST_ASSERT_TRUE(fabs(ldexp(moved(move_at(i)), -30) - F / sum * 0x1p-62) <= 3e-9); /* slip: 1.5e-9 of it */
    }
    TEST_ASSERT_EQUAL_INT32(1 << 30, moved(1 << 28));
    TEST_ASSERT_EQUAL_INT32(-(1 << 30), moved(-(1 << 29)));
}

static void test_a_mix_answers_the_sum(void)
{
    const dahl_node_parallel_params_t dahl_alone = {2, 0, 1e-4f, {100.0f, 60.0f}, {0.25f, 5.0f}};
    const dahl_node_parallel_params_t slip_alone = {1, 1, 1e-4f, {100.0f}, {0.25f}};
    const dahl_node_parallel_params_t far_apart = {3, 2, 1e-4f, {1e9f, 1e-9f, 1.0f}, {1e7f, 1e-11f, 0.1f}};
    dahl_node_parallel_params_t eight = {8, 0x55u, 1e-4f, {0}, {0}};
    for (uint32_t k = 0; k < 8; k++) {
        eight.sigma0[k] = 100.0f * (float)(k + 1);
        eight.Fc[k] = 0.1f + 0.37f * (float)k;
    }
    const dahl_node_parallel_params_t *all[] = {&mix, &dahl_alone, &slip_alone, &far_apart, &eight};
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++) {
        setUp();
        check_mix(all[i]);
    }
}

static void test_a_mix_tells_its_sums(void)
{
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_use_parallel(&node, &parallel, &mix));
    check_told(DAHL_FRAMES_MODEL_PARALLEL + 4, 400u << 10, (uint32_t)lround(ldexp((double)(0.25f + 0.5f + 1.0f + 0.3f), 20)));
    moved(0);
    check_restart_relaxes();
}

static void check_refused(dahl_node_parallel_params_t bad)
{
    dahl_node_parallel_t kept = parallel;
    dahl_node_t before = node;
    TEST_ASSERT_TRUE(dahl_node_use_parallel(&node, &parallel, &bad) != DAHL_OK);
    TEST_ASSERT_EQUAL_MEMORY(&before, &node, sizeof node);
    TEST_ASSERT_EQUAL_MEMORY(&kept, &parallel, sizeof parallel);
}

static void test_bad_elements_touch_nothing(void)
{
    dahl_node_parallel_params_t bad = mix;
    const float not_positive[] = {0.0f, -1.0f, NAN, INFINITY};
    for (size_t i = 0; i < 4; i++) {
        bad = mix;
        bad.Fc[0] = not_positive[i]; /* one of Dahl's */
        check_refused(bad);
        bad = mix;
        bad.sigma0[2] = not_positive[i]; /* one that slips */
        check_refused(bad);
        bad = mix;
        bad.theta_per_count = not_positive[i];
        check_refused(bad);
    }
    bad = mix;
    bad.elements = 0;
    check_refused(bad);
    TEST_ASSERT_EQUAL(DAHL_ERR_PARAM, dahl_node_use_parallel(&node, &parallel, &bad));
    bad.elements = 9;
    check_refused(bad);
    TEST_ASSERT_EQUAL(DAHL_ERR_RANGE, dahl_node_use_parallel(&node, &parallel, &bad));
}

static void test_bad_parameters_touch_nothing(void)
{
    dahl_asymmetric_params_t bad = preloaded;
    dahl_slip_params_t bad_springs = springs;
    dahl_node_t before = node;
    dahl_node_slip_t kept = slipping;
    bad_springs.Fc[2] = -1.0f;
    TEST_ASSERT_EQUAL(DAHL_ERR_PARAM, dahl_node_use_slip(&node, &slipping, &bad_springs));
    bad_springs = springs;
    bad_springs.elements = 9;
    TEST_ASSERT_TRUE(dahl_node_use_slip(&node, &slipping, &bad_springs) != DAHL_OK);
    TEST_ASSERT_EQUAL_MEMORY(&kept, &slipping, sizeof slipping);
    bad.Fc_backward = -1.0f;
    TEST_ASSERT_EQUAL(DAHL_ERR_PARAM, dahl_node_use_asymmetric(&node, &asymmetric, &bad));
    TEST_ASSERT_TRUE(dahl_node_use_loaded(&node, &loaded, &(const dahl_params_t){100.0f, -0.5f, 1e-4f}) != DAHL_OK);
    TEST_ASSERT_EQUAL(DAHL_ERR_RANGE, dahl_node_use_elastoplastic(&node, &elastoplastic, &bearing, 1.0f));
    TEST_ASSERT_EQUAL_MEMORY(&before, &node, sizeof node);
}

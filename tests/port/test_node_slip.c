/* SPDX-License-Identifier: MIT */
/* A node that answers by slip elements: the bits of the library, and what a client is told. */
#include <string.h>
#include <unity.h>

#include "ask_node.h"
#include "dahl_node.h"

static const dahl_params_t dahl_params = {50.0f, 0.5f, 1e-4f};
static const dahl_slip_params_t slip_params = {3, 1e-4f, {100.0f, 60.0f, 40.0f}, {0.25f, 0.5f, 1.0f}};
static dahl_node_t node;
static dahl_node_slip_t slip;
static dahl_slip_plan_t plan;
static dahl_friction_torque_t torque;
static uint32_t now_us;

void setUp(void)
{
    now_us = 0;
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_init(&node, &dahl_params, 3));
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_use_slip(&node, &slip, &slip_params));
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_slip_prepare(&plan, &slip_params));
}

void tearDown(void) {}

static bool feed(uint32_t counter, int32_t count)
{
    const dahl_encoder_state_t seen = {.counter = (uint8_t)(counter & 15u), .valid = 1, .count = count};
    dahl_can_frame_t in, out;
    dahl_frames_pack_encoder(&in, 3, &seen);
    now_us += 1000;
    return dahl_node_receive(&node, &in, now_us, &out) && dahl_frames_unpack_torque(&out, &torque) == DAHL_FRAMES_GOOD;
}

static dahl_param_reply_t ask(uint8_t param, uint8_t write, uint32_t value)
{
    return ask_node(&node, now_us, param, write, value);
}

static void test_answers_are_the_librarys(void)
{
    dahl_slip_state_t reference = {{0}};
    int32_t count = 0;
    TEST_ASSERT_TRUE(feed(0, count));
    TEST_ASSERT_EQUAL(0, torque.torque_q30);
    for (uint32_t i = 1; i < 3000; i++) {
        int32_t step = (int32_t)(i * i % 401u) - 200;
        count += step;
        TEST_ASSERT_TRUE(feed(i, count));
        TEST_ASSERT_EQUAL(dahl_slip_step_counts_q30(&plan, &reference, step), torque.torque_q30);
    }
    TEST_ASSERT_EQUAL_MEMORY(&reference, &slip.state, sizeof reference);
}

static void test_a_client_is_told_the_model(void)
{
    TEST_ASSERT_EQUAL(3, ask(DAHL_FRAMES_PARAM_MODEL, DAHL_FRAMES_PARAM_READ, 0).value);
    TEST_ASSERT_EQUAL(200u << 10, ask(DAHL_FRAMES_PARAM_SIGMA0, DAHL_FRAMES_PARAM_READ, 0).value);
    TEST_ASSERT_EQUAL(7u << 18, ask(DAHL_FRAMES_PARAM_FC, DAHL_FRAMES_PARAM_READ, 0).value); /* 1.75 N m */
    TEST_ASSERT_EQUAL((uint32_t)(1e-4f * 0x1p38f), ask(DAHL_FRAMES_PARAM_THETA, DAHL_FRAMES_PARAM_READ, 0).value);
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_init(&node, &dahl_params, 3));
    TEST_ASSERT_EQUAL(0, ask(DAHL_FRAMES_PARAM_MODEL, DAHL_FRAMES_PARAM_READ, 0).value);
}

/* Neither a sum of elements nor the model can be set over the bus; what cannot be set stays. */
static void test_the_model_is_not_written(void)
{
    for (uint8_t param = DAHL_FRAMES_PARAM_SIGMA0; param <= DAHL_FRAMES_PARAM_THETA; param++) {
        uint32_t before = ask(param, DAHL_FRAMES_PARAM_READ, 0).value;
        TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_OUT_OF_RANGE, ask(param, DAHL_FRAMES_PARAM_WRITE, 1u << 19).result);
        TEST_ASSERT_EQUAL(before, ask(param, DAHL_FRAMES_PARAM_HOLD, 1u << 19).value);
    }
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_OUT_OF_RANGE, ask(DAHL_FRAMES_PARAM_MODEL, DAHL_FRAMES_PARAM_WRITE, 1).result);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_OUT_OF_RANGE, ask(DAHL_FRAMES_PARAM_MODEL, DAHL_FRAMES_PARAM_HOLD, 1).result);
    TEST_ASSERT_EQUAL(3, ask(DAHL_FRAMES_PARAM_MODEL, DAHL_FRAMES_PARAM_READ, 0).value);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_DONE, ask(DAHL_FRAMES_PARAM_GAIN, DAHL_FRAMES_PARAM_WRITE, 65536).result);
}

static void test_a_restart_relaxes_all_elements(void)
{
    const dahl_node_reset_t restart = {.what = DAHL_FRAMES_RESET_RESTART};
    const dahl_slip_state_t relaxed = {{0}};
    dahl_can_frame_t in, out;
    feed(0, 0);
    TEST_ASSERT_TRUE(feed(1, 100000) && torque.torque_q30 == 1 << 30);
    dahl_frames_pack_reset(&in, 3, &restart);
    TEST_ASSERT_TRUE(dahl_node_receive(&node, &in, now_us, &out));
    TEST_ASSERT_EQUAL_MEMORY(&relaxed, &slip.state, sizeof relaxed);
    TEST_ASSERT_TRUE(feed(2, 100000) && torque.torque_q30 == 0);
}

static void test_bad_elements_touch_nothing(void)
{
    dahl_slip_params_t bad = slip_params;
    dahl_node_t before = node;
    dahl_node_slip_t kept = slip;
    bad.Fc[2] = -1.0f;
    TEST_ASSERT_EQUAL(DAHL_ERR_PARAM, dahl_node_use_slip(&node, &slip, &bad));
    bad = slip_params;
    bad.elements = 9;
    TEST_ASSERT_TRUE(dahl_node_use_slip(&node, &slip, &bad) != DAHL_OK);
    TEST_ASSERT_EQUAL_MEMORY(&before, &node, sizeof node);
    TEST_ASSERT_EQUAL_MEMORY(&kept, &slip, sizeof slip);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_answers_are_the_librarys);
    RUN_TEST(test_a_client_is_told_the_model);
    RUN_TEST(test_the_model_is_not_written);
    RUN_TEST(test_a_restart_relaxes_all_elements);
    RUN_TEST(test_bad_elements_touch_nothing);
    return UNITY_END();
}

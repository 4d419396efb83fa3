/* SPDX-License-Identifier: MIT */
/* One node, its clock, and the frames of an encoder and of a client. Include Unity before. */
#ifndef TEST_NODE_TALK_H
#define TEST_NODE_TALK_H

#include "dahl_node.h"

enum { NUMBER = 3 };

static const dahl_params_t params = {.sigma0 = 50.0f, .Fc = 0.5f, .theta_per_count = 1e-4f};
static dahl_node_t node;
static uint32_t now_us;
static dahl_friction_torque_t answer; /* the last one */

static inline void talk_begin(void)
{
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_init(&node, &params, NUMBER));
    now_us = 0xFFFF0000u; /* wraps after 65 ms */
}

static inline dahl_can_frame_t encoder_frame(uint32_t counter, int32_t count, bool valid)
{
    dahl_encoder_state_t state = {.count = count, .counter = counter & 0x0F, .valid = valid};
    dahl_can_frame_t frame;
    dahl_frames_pack_encoder(&frame, NUMBER, &state);
    return frame;
}

/* Pass a frame to the node after 1 ms. Return true and fill `answer` if it sends a torque. */
static inline bool give(const dahl_can_frame_t *frame)
{
    dahl_can_frame_t out;
    now_us += 1000;
    if (!dahl_node_receive(&node, frame, now_us, &out)) {
        return false;
    }
    TEST_ASSERT_EQUAL_HEX32(DAHL_FRAMES_ID_TORQUE | NUMBER, out.id);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_GOOD, dahl_frames_unpack_torque(&out, &answer));
    return true;
}

static inline bool feed(uint32_t counter, int32_t count)
{
    dahl_can_frame_t frame = encoder_frame(counter, count, true);
    return give(&frame);
}

static inline dahl_param_reply_t ask(uint8_t param, uint8_t write, uint32_t value)
{
    const dahl_param_write_t asked = {.value = value, .counter = 5, .param = param, .write = write};
    dahl_param_reply_t reply;
    dahl_can_frame_t in, out;
    dahl_frames_pack_param_write(&in, NUMBER, &asked);
    TEST_ASSERT_TRUE(dahl_node_receive(&node, &in, now_us, &out));
    TEST_ASSERT_EQUAL_HEX32(DAHL_FRAMES_ID_PARAM_REPLY | NUMBER, out.id);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_GOOD, dahl_frames_unpack_param_reply(&out, &reply));
    TEST_ASSERT_EQUAL(5, reply.counter);
    TEST_ASSERT_EQUAL(reply.result == DAHL_FRAMES_PARAM_UNKNOWN ? DAHL_FRAMES_PARAM_NONE : param, reply.param);
    return reply;
}

/* Return true if the node accepts the value, which it must then return. */
static inline bool set_param(uint8_t param, uint32_t value)
{
    const dahl_param_reply_t reply = ask(param, DAHL_FRAMES_PARAM_WRITE, value);
    TEST_ASSERT_TRUE(reply.result != DAHL_FRAMES_PARAM_DONE || reply.value == value);
    return reply.result == DAHL_FRAMES_PARAM_DONE;
}

static inline uint32_t param_now(uint8_t param)
{
    const dahl_param_reply_t reply = ask(param, DAHL_FRAMES_PARAM_READ, 0);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_DONE, reply.result);
    return reply.value;
}

static inline dahl_can_frame_t reset(uint8_t what)
{
    dahl_can_frame_t frame, out;
    dahl_frames_pack_reset(&frame, NUMBER, &(dahl_node_reset_t){.what = what});
    TEST_ASSERT_TRUE(dahl_node_receive(&node, &frame, now_us, &out));
    TEST_ASSERT_EQUAL_HEX32(DAHL_FRAMES_ID_STATUS | NUMBER, out.id);
    return out;
}

#endif

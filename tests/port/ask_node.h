/* SPDX-License-Identifier: MIT */
/* ask_node: what node 3 answers to a client that reads or writes one of its parameters. Unity comes first. */
#ifndef TEST_ASK_NODE_H
#define TEST_ASK_NODE_H

#include "dahl_node.h"

static inline dahl_param_reply_t ask_node(dahl_node_t *node, uint32_t now_us, uint8_t param, uint8_t write, uint32_t value)
{
    const dahl_param_write_t asked = {.param = param, .write = write, .value = value};
    dahl_param_reply_t reply;
    dahl_can_frame_t in, out;
    dahl_frames_pack_param_write(&in, 3, &asked);
    TEST_ASSERT_TRUE(dahl_node_receive(node, &in, now_us, &out));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_GOOD, dahl_frames_unpack_param_reply(&out, &reply));
    return reply;
}

#endif

/* SPDX-License-Identifier: MIT */
/*
 * fuzz_frames [FRAMES [SEED]]: whatever frames come, from noise to good ones with foolish contents, the node stays whole:
 * each has one fate, each answer is a good frame, no torque is beyond Fc. Meant for a build with sanitizers.
 */
#include <stdio.h>
#include <stdlib.h>

#include "frames.h"
#include "node.h"
#include "random.h"

static const uint8_t kinds[] = {FRAMES_KIND_ENCODER, FRAMES_KIND_TORQUE,      FRAMES_KIND_STATUS,
                                FRAMES_KIND_PARAM_WRITE, FRAMES_KIND_PARAM_REPLY, FRAMES_KIND_RESET};

static void fail(const char *what, uint64_t frame)
{
    fprintf(stderr, "error: %s at frame %llu\n", what, (unsigned long long)frame);
    exit(1);
}

/* Noise, often with the id and the CRC of a message, and then often the next in sequence. */
static can_frame_t any_frame(uint64_t *seed, const node_t *node)
{
    uint32_t chance = random_u32(seed);
    size_t kind = chance % 6;
    can_frame_t frame = {.id = 0x100u + 0x10u * (uint32_t)kind + node->number, .length = 8};
    for (size_t i = 0; i < 8; i++) {
        frame.data[i] = (uint8_t)random_u32(seed);
    }
    if ((chance & 0x700u) != 0) {
        frame.data[1] = (uint8_t)((frame.data[1] & 0xF0) | ((node->counter + 1) & 0x0F));
    }
    if (kind == 3 && (chance & 0x800u) != 0) { /* values that may be taken */
        frame.data[2] %= 10;
        frame.data[6] = 0;
        frame.data[7] = 0;
    }
    if ((chance & 0x7000u) != 0) {
        frame.data[0] = frames_crc(frame.data, kinds[kind]);
    }
    if ((chance & 0xF0000u) == 0) {
        frame.id = random_u32(seed) & 0x1FFFFFFFu;
        frame.flags = (uint8_t)random_u32(seed);
        frame.length = (uint8_t)(random_u32(seed) % 9);
    }
    return frame;
}

static void check_answer(const can_frame_t *out, uint64_t frame)
{
    friction_torque_t torque;
    param_reply_t reply;
    node_status_t status;
    uint32_t kind = out->id & 0x7F0u;
    if (kind == FRAMES_ID_TORQUE && frames_unpack_torque(out, &torque) == FRAMES_GOOD) {
        if (torque.torque_q30 > 1 << 30 || torque.torque_q30 < -(1 << 30)) {
            fail("a torque beyond Fc", frame);
        }
    } else if (!(kind == FRAMES_ID_PARAM_REPLY && frames_unpack_param_reply(out, &reply) == FRAMES_GOOD) &&
               !(kind == FRAMES_ID_STATUS && frames_unpack_status(out, &status) == FRAMES_GOOD)) {
        fail("an answer that is no good frame", frame);
    }
}

static uint64_t fates(const node_counts_t *n)
{
    return (uint64_t)n->ok + n->repeated + n->wrong_sequence + n->crc + n->format + n->invalid + n->jump + n->rearm +
           n->ignored + n->params + n->resets + n->bus_off;
}

/* A Reset of the errors clears the counts; then it is itself not among them. */
static void check_fate(const node_t *node, uint64_t before, uint64_t frame)
{
    uint64_t now = fates(&node->counts);
    if (now != before + 1 && now != 0) {
        fail("a frame with no fate, or with two", frame);
    }
    if (node->gain_now > NODE_ONE) {
        fail("a state out of range", frame);
    }
}

int main(int argc, char **argv)
{
    uint64_t frames = argc > 1 ? strtoull(argv[1], NULL, 10) : 1000000;
    uint64_t seed = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
    uint32_t now_us = 0xFF000000u;
    uint64_t answers = 0;
    node_t node;
    if (node_init(&node, &(dahl_params_t){50.0f, 0.5f, 1e-4f}, 3) != DAHL_OK) {
        fail("node_init", 0);
    }
    for (uint64_t i = 0; i < frames; i++) {
        can_frame_t in = any_frame(&seed, &node);
        can_frame_t out;
        uint64_t before = fates(&node.counts);
        now_us += random_u32(&seed) % 3000;
        if (node_receive(&node, &in, now_us, &out)) {
            check_answer(&out, i);
            answers++;
        }
        check_fate(&node, before, i);
        if (node_tick(&node, now_us, &out)) {
            check_answer(&out, i);
        }
    }
    printf("%llu frames, %llu answers\n", (unsigned long long)frames, (unsigned long long)answers);
    return answers > frames / 10 ? 0 : 1;
}

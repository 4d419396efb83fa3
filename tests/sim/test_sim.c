/* SPDX-License-Identifier: MIT */
/* Modules of dahl-loop whose limits no run reaches: the histogram, the encoder's list of open answers, errors of the log. */
#define _GNU_SOURCE
#include <errno.h>
#include <string.h>
#include <unistd.h>
#include <unity.h>

#include "candump.h"
#include "encoder_node.h"
#include "dahl_frames.h"
#include "histogram.h"
#include "motion.h"

static run_motion_t still;
static motion_t motion;
static encoder_t encoder;

void setUp(void)
{
    still = (run_motion_t){.number = MOTION_STEERING, .sweep_s = 1, .seconds = 1000};
    TEST_ASSERT_TRUE(motion_open(&motion, &still, "", 1));
    encoder = (encoder_t){.motion = &motion};
}

void tearDown(void)
{
    motion_close(&motion);
}

/* Bins are exact below 64 ns; above, the upper edge is at most 1/32 too high. */
static void test_each_duration_is_in_the_bin_of_its_size(void)
{
    for (uint32_t bit = 0; bit < 64; bit++) {
        static histogram_t one;
        uint64_t ns = UINT64_C(1) << bit;
        size_t bin = 0;
        memset(&one, 0, sizeof one);
        histogram_add(&one, ns);
        while (one.bins[bin] == 0) {
            bin++;
        }
        TEST_ASSERT_EQUAL_UINT64(1, one.count);
        TEST_ASSERT_EQUAL_UINT64(ns, one.max);
        TEST_ASSERT_TRUE(ns <= histogram_edge(bin) && histogram_edge(bin) - ns <= ns / 32);
        TEST_ASSERT_TRUE(bin == 0 || histogram_edge(bin - 1) < ns);
    }
}

/* Also in the last bin, that of UINT64_MAX. */
static void test_a_merge_is_the_histogram_of_all_durations(void)
{
    static histogram_t parts[2], merged, all;
    for (uint32_t i = 0; i < 3 * 65; i++) {
        const uint64_t ns = UINT64_MAX >> i / 3;
        histogram_add(&parts[i % 2], ns);
        histogram_add(&all, ns);
    }
    histogram_merge(&merged, &parts[1]);
    histogram_merge(&merged, &parts[0]);
    histogram_merge(&merged, &(const histogram_t){.count = 0});
    TEST_ASSERT_EQUAL_MEMORY(&all, &merged, sizeof all);
}

static void send(uint32_t frames)
{
    dahl_can_frame_t frame;
    for (uint32_t i = 0; i < frames; i++) {
        TEST_ASSERT_TRUE(encoder_tick(&encoder, encoder.sent * 1000000u, &frame));
    }
}

static void answer(uint32_t echo, dahl_frames_state_t state, uint64_t now_ns)
{
    dahl_friction_torque_t torque = {.echo = echo & 0x0F, .state = (uint8_t)state};
    dahl_can_frame_t frame;
    dahl_frames_pack_torque(&frame, 0, &torque);
    encoder_receive(&encoder, &frame, now_ns);
}

static void test_each_answer_is_matched_once(void)
{
    dahl_can_frame_t frame;
    dahl_friction_torque_t torque = {.echo = 3};
    for (uint32_t i = 0; i < 100; i++) {
        send(1);
        answer(i, DAHL_FRAMES_OK, i * UINT64_C(1000000) + 300);
        answer(i, DAHL_FRAMES_OK, i * UINT64_C(1000000) + 400);
    }
    send(1);
    dahl_frames_pack_torque(&frame, 1, &torque);
    encoder_receive(&encoder, &frame, 1);
    dahl_frames_pack_torque(&frame, 0, &torque);
    frame.data[5] ^= 1;
    encoder_receive(&encoder, &frame, 1);
    TEST_ASSERT_EQUAL(100, encoder.answered);
    TEST_ASSERT_EQUAL(100, encoder.unmatched);
    TEST_ASSERT_EQUAL(1, encoder.corrupt);
    TEST_ASSERT_EQUAL(300, encoder.latency.max);
}

/* If more than 16 frames wait, a node with a new start answers the newest with this counter, any other node the oldest. The
 * oldest of too many waiting frames are lost. */
static void test_an_answer_after_a_gap_matches_the_right_frame(void)
{
    static const struct {
        dahl_frames_state_t state;
        uint32_t waiting, echo;
        uint64_t of; /* number of the frame, sent in this millisecond */
    } known[] = {
        {DAHL_FRAMES_INIT, 40, 5, 37},  {DAHL_FRAMES_STALE, 40, 5, 37}, {DAHL_FRAMES_WRONG_SEQUENCE, 40, 5, 37},
        {DAHL_FRAMES_OK, 40, 5, 5},     {DAHL_FRAMES_LOST, 40, 5, 5},   {DAHL_FRAMES_INIT, 16, 5, 5},
        {DAHL_FRAMES_STALE, 17, 5, 5},  {DAHL_FRAMES_STALE, 22, 5, 21}, {DAHL_FRAMES_OK, 22, 5, 5},
        {DAHL_FRAMES_OK, 5000, 5000 - ENCODER_WAITING, 5000 - ENCODER_WAITING},
    };
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        encoder = (encoder_t){.motion = &motion};
        send(known[i].waiting);
        answer(known[i].echo, known[i].state, UINT64_C(6000000000));
        TEST_ASSERT_EQUAL(1, encoder.answered);
        TEST_ASSERT_EQUAL_UINT64(known[i].of + 1, encoder.torque_of);
        TEST_ASSERT_EQUAL_UINT64(6000000000 - known[i].of * 1000000, encoder.latency.max);
    }
}

/* The first error is kept, although a later call sets another errno. */
static void test_errors_of_a_log_are_reported_at_its_close(void)
{
    static candump_t log;
    const dahl_can_frame_t frame = {.id = 0x100, .length = 8};
    TEST_ASSERT_TRUE(candump_open(&log, "/dev/full", "vcan0", false));
    for (uint32_t i = 0; i < 1000; i++) {
        candump_write(&log, &frame);
    }
    errno = EINTR;
    TEST_ASSERT_FALSE(candump_close(&log));
    TEST_ASSERT_EQUAL(ENOSPC, errno);
    memset(&log, 0, sizeof log);
    TEST_ASSERT_TRUE(candump_open(&log, "/dev/null", "vcan0", false));
    close(log.fd); /* an error of the last write is reported too */
    TEST_ASSERT_FALSE(candump_close(&log));
    TEST_ASSERT_EQUAL(EBADF, errno);
}

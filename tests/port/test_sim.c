/* SPDX-License-Identifier: MIT */
/* The parts of dahl-loop that need no bus: histogram, the encoder's book of answers, motions. */
#define _GNU_SOURCE
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <unity.h>

#include "candump.h"
#include "encoder.h"
#include "dahl_frames.h"
#include "histogram.h"
#include "loop.h"
#include "loopback/loopback.h"
#include "motion.h"
#include "random.h"
#include "summary.h"

static scene_motion_t still;
static motion_t motion;
static encoder_t encoder;

void setUp(void)
{
    still = (scene_motion_t){.kind = MOTION_STEERING, .sweep_s = 1, .seconds = 1000};
    TEST_ASSERT_TRUE(motion_open(&motion, &still, "", "", 1));
    encoder = (encoder_t){.motion = &motion};
}

void tearDown(void)
{
    motion_close(&motion);
}

static void test_quantiles_of_few_short_durations_are_exact(void)
{
    static histogram_t histogram;
    for (uint64_t ns = 1; ns <= 20; ns++) {
        histogram_add(&histogram, ns);
    }
    TEST_ASSERT_EQUAL(1, histogram_quantile(&histogram, 0.05));
    TEST_ASSERT_EQUAL(10, histogram_quantile(&histogram, 0.5));
    TEST_ASSERT_EQUAL(11, histogram_quantile(&histogram, 0.501));
    TEST_ASSERT_EQUAL(20, histogram_quantile(&histogram, 0.99));
}

static void test_a_histogram_takes_everything(void)
{
    static histogram_t histogram;
    TEST_ASSERT_EQUAL(0, histogram_quantile(&histogram, 0.5));
    for (uint32_t bit = 0; bit < 64; bit++) {
        histogram_add(&histogram, UINT64_C(1) << bit);
        histogram_add(&histogram, (UINT64_C(1) << bit) - 1);
    }
    histogram_add(&histogram, UINT64_MAX);
    TEST_ASSERT_TRUE(histogram_quantile(&histogram, 1.0) == UINT64_MAX);
    TEST_ASSERT_EQUAL(0, histogram_quantile(&histogram, 0.001));
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
    for (uint32_t i = 0; i < 100; i++) {
        send(1);
        answer(i, DAHL_FRAMES_OK, i * UINT64_C(1000000) + 300);
        answer(i, DAHL_FRAMES_OK, i * UINT64_C(1000000) + 400);
    }
    TEST_ASSERT_EQUAL(100, encoder.answered);
    TEST_ASSERT_EQUAL(100, encoder.unmatched);
    TEST_ASSERT_EQUAL(300, encoder.latency.max);
}

/* An answer within its period is in time, up to the last nanosecond. */
static void test_an_answer_after_its_period_is_a_deadline_missed(void)
{
    send(3);
    answer(0, DAHL_FRAMES_OK, ENCODER_PERIOD_NS);
    TEST_ASSERT_EQUAL(0, encoder.late);
    answer(1, DAHL_FRAMES_OK, 2 * ENCODER_PERIOD_NS + 1);
    answer(2, DAHL_FRAMES_OK, 3 * ENCODER_PERIOD_NS);
    TEST_ASSERT_EQUAL(1, encoder.late);
}

static void test_jitter_is_the_change_from_one_answer_to_the_next(void)
{
    send(3);
    answer(0, DAHL_FRAMES_OK, 400000);
    TEST_ASSERT_EQUAL(0, encoder.jitter.count);
    answer(1, DAHL_FRAMES_OK, 1 * ENCODER_PERIOD_NS + 300000);
    answer(2, DAHL_FRAMES_OK, 2 * ENCODER_PERIOD_NS + 330000);
    TEST_ASSERT_EQUAL(2, encoder.jitter.count);
    TEST_ASSERT_EQUAL(100000, encoder.jitter.max);
    TEST_ASSERT_EQUAL(400000, encoder.latency.max);
}

/* More than 16 wait. A node that starts anew answers the newest with this counter, one that goes on the oldest; of 16 and
 * fewer there is one of each counter. */
static void test_whose_answer_it_is_after_a_gap(void)
{
    static const struct {
        dahl_frames_state_t state;
        uint32_t waiting;
        uint64_t of; /* frame, which was sent in this millisecond */
    } known[] = {
        {DAHL_FRAMES_INIT, 40, 37},  {DAHL_FRAMES_STALE, 40, 37}, {DAHL_FRAMES_WRONG_SEQUENCE, 40, 37},
        {DAHL_FRAMES_OK, 40, 5},     {DAHL_FRAMES_LOST, 40, 5},   {DAHL_FRAMES_INIT, 16, 5},
        {DAHL_FRAMES_STALE, 17, 5},  {DAHL_FRAMES_STALE, 22, 21}, {DAHL_FRAMES_OK, 22, 5},
    };
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        encoder = (encoder_t){.motion = &motion};
        send(known[i].waiting);
        answer(5, known[i].state, UINT64_C(100000000));
        TEST_ASSERT_EQUAL(1, encoder.answered);
        TEST_ASSERT_EQUAL_UINT64(known[i].of + 1, encoder.torque_of);
        TEST_ASSERT_EQUAL_UINT64(100000000 - known[i].of * 1000000, encoder.latency.max);
    }
}

static void test_waiting_frames_are_bounded(void)
{
    send(5000);
    TEST_ASSERT_TRUE(encoder.sent - encoder.next <= ENCODER_WAITING);
    answer(5000 - ENCODER_WAITING, DAHL_FRAMES_OK, UINT64_C(5000000000));
    TEST_ASSERT_EQUAL(1, encoder.answered);
}

static void test_foreign_and_corrupt_answers(void)
{
    dahl_can_frame_t frame;
    dahl_friction_torque_t torque = {.echo = 0};
    send(1);
    dahl_frames_pack_torque(&frame, 1, &torque);
    encoder_receive(&encoder, &frame, 1);
    dahl_frames_pack_torque(&frame, 0, &torque);
    frame.data[5] ^= 1;
    encoder_receive(&encoder, &frame, 1);
    TEST_ASSERT_EQUAL(0, encoder.answered);
    TEST_ASSERT_EQUAL(1, encoder.corrupt);
}

static void test_each_kind_of_frame_is_a_line_that_candump_would_write(void)
{
    const dahl_can_frame_t frames[] = {
        {.time_us = 1234567890000001, .id = 0x1F, .length = 2, .data = {0x0A, 0xFF}},
        {.time_us = 999999, .id = 0x1ABCDEF, .flags = DAHL_CAN_FRAME_EXTENDED, .length = 1, .data = {1}},
        {.time_us = 1000000, .id = 0x7FF, .length = 0},
        {.time_us = 1000010, .id = 0x100, .flags = DAHL_CAN_FRAME_REMOTE, .length = 8},
        {.time_us = 1000011, .id = 0x100, .flags = DAHL_CAN_FRAME_REMOTE},
        {.time_us = 1000011, .id = 0x101, .flags = DAHL_CAN_FRAME_FD, .length = 2, .data = {0x12, 3}},
        {.time_us = 1000012, .id = 0x40, .flags = DAHL_CAN_FRAME_ERROR, .length = 1, .data = {0x99}},
    };
    const char want[] = "(1234567890.000001) vcan0 01F#0AFF\n(0000000000.999999) vcan0 01ABCDEF#01\n"
                        "(0000000001.000000) vcan0 7FF#\n(0000000001.000010) vcan0 100#R8\n"
                        "(0000000001.000011) vcan0 100#R\n(0000000001.000011) vcan0 101##01203\n(0000000001.000012) vcan0 20000040#99\n";
    char text[sizeof want + 1] = "";
    static candump_t log;
    FILE *file = tmpfile();
    log = (candump_t){.fd = dup(fileno(file)), .bus_name = "vcan0"};
    TEST_ASSERT_TRUE(log.fd >= 0);
    for (size_t i = 0; i < sizeof frames / sizeof frames[0]; i++) {
        candump_write(&log, &frames[i]);
    }
    TEST_ASSERT_TRUE(candump_close(&log));
    rewind(file);
    TEST_ASSERT_EQUAL(sizeof want - 1, fread(text, 1, sizeof text, file));
    TEST_ASSERT_EQUAL_STRING(want, text);
    fclose(file);
}

/* What went wrong first is told at the end, whatever has gone wrong since: here an interrupted wait. */
static void test_a_full_disk_is_told_at_the_end_with_what_is_missing(void)
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
    TEST_ASSERT_EQUAL(1000, log.missing);
    memset(&log, 0, sizeof log);
    TEST_ASSERT_TRUE(candump_open(&log, "/dev/null", "vcan0", false));
    close(log.fd); /* what fails at the very end is told too */
    TEST_ASSERT_FALSE(candump_close(&log));
    TEST_ASSERT_EQUAL(EBADF, errno);
}

static char summary[4096];

static void write_summary(const loop_t *loop)
{
    const options_t options = {.bus = "loopback", .scene = "a.ini", .seed = 7};
    const scene_t scene = {.title = "A"};
    char path[] = "/tmp/test_sim_XXXXXX";
    int fd = mkstemp(path);
    TEST_ASSERT_TRUE(fd >= 0);
    memset(summary, 0, sizeof summary);
    TEST_ASSERT_TRUE(summary_write(path, &options, &scene, loop, NULL));
    TEST_ASSERT_TRUE(read(fd, summary, sizeof summary - 1) > 0);
    close(fd);
    unlink(path);
}

/* What follows "name": in a text. */
static const char *after(const char *text, const char *name)
{
    char key[64];
    snprintf(key, sizeof key, "\"%s\":", name);
    const char *found = strstr(text, key);
    TEST_ASSERT_NOT_NULL_MESSAGE(found, name);
    return found + strlen(key);
}

/* The number after the first "name": of the summary. */
static double said(const char *name)
{
    return strtod(after(summary, name), NULL);
}

static void test_the_summary_says_what_was_counted(void)
{
    static loop_t loop;
    loopback_t bus;
    sim_clock_t clock;
    sim_clock_start(&clock, false);
    loopback_open(&bus, sim_clock_seam(&clock));
    for (uint32_t i = 0; i < 99; i++) { /* 1 to 99 us */
        send(1);
        answer(i, DAHL_FRAMES_OK, i * UINT64_C(1000000) + (i + 1) * UINT64_C(1000));
    }
    send(1);
    loop = (loop_t){.clock = &clock, .bus = &bus.bus, .encoders = &encoder, .encoder_count = 1, .ticks = 100, .wall_ns = 50000000};
    write_summary(&loop);
    TEST_ASSERT_EQUAL_DOUBLE(100, said("frames_sent"));
    TEST_ASSERT_EQUAL_DOUBLE(99, said("frames_answered"));
    TEST_ASSERT_EQUAL_DOUBLE(1, said("frames_lost"));
    TEST_ASSERT_DOUBLE_WITHIN(1.6, 50, said("p50"));
    TEST_ASSERT_DOUBLE_WITHIN(3.2, 98.5, said("p99"));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 99, said("max"));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.05, said("wall_s"));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 2, said("realtime_factor"));
    TEST_ASSERT_EQUAL_DOUBLE(7, said("seed"));
    TEST_ASSERT_NULL(strstr(summary, "\"node\":"));
}

static void test_the_summary_adds_up_all_encoders_and_nodes(void)
{
    static encoder_t encoders[2];
    static loop_t loop;
    dahl_node_t nodes[2] = {{.counts = {.ok = 3, .crc = 1}}, {.counts = {.ok = 4}}};
    loopback_t bus;
    sim_clock_t clock;
    sim_clock_start(&clock, false);
    loopback_open(&bus, sim_clock_seam(&clock));
    encoders[0] = (encoder_t){.sent = 10, .answered = 7, .unmatched = 2, .corrupt = 1, .late = 3};
    encoders[1] = (encoder_t){.sent = 5, .answered = 4, .unmatched = 6, .corrupt = 8, .late = 2};
    histogram_add(&encoders[0].latency, 2000);
    histogram_add(&encoders[1].latency, 1000);
    histogram_add(&encoders[1].jitter, 5000);
    loop = (loop_t){.clock = &clock, .bus = &bus.bus, .encoders = encoders, .encoder_count = 2, .nodes = nodes, .node_count = 2};
    write_summary(&loop);
    TEST_ASSERT_EQUAL_DOUBLE(15, said("frames_sent"));
    TEST_ASSERT_EQUAL_DOUBLE(11, said("frames_answered"));
    TEST_ASSERT_EQUAL_DOUBLE(4, said("frames_lost"));
    TEST_ASSERT_EQUAL_DOUBLE(8, said("answers_unmatched"));
    TEST_ASSERT_EQUAL_DOUBLE(9, said("answers_corrupt"));
    TEST_ASSERT_EQUAL_DOUBLE(5, said("deadline_misses"));
    TEST_ASSERT_EQUAL_DOUBLE(2, strtod(after(after(summary, "latency_us"), "max"), NULL));
    TEST_ASSERT_EQUAL_DOUBLE(5, strtod(after(after(summary, "jitter_us"), "max"), NULL));
    TEST_ASSERT_EQUAL_DOUBLE(2, said("nodes"));
    TEST_ASSERT_EQUAL_DOUBLE(7, said("ok"));
    TEST_ASSERT_EQUAL_DOUBLE(1, said("crc"));
}

static void test_segments_rest_at_each_end(void)
{
    scene_motion_t scene = {.kind = MOTION_SEGMENTS, .theta1 = 2, .theta2 = 1, .theta3 = 2, .speed = 1000,
                            .hold_s = 0.003};
    const int32_t want[] = {0, 1, 2, 2, 2, 2, 1, 1, 1, 1, 2, 2, 2, 2};
    int32_t got[32] = {0};
    size_t ticks = 0;
    TEST_ASSERT_TRUE(motion_open(&motion, &scene, "", "", 1));
    while (ticks < 32 && motion_next(&motion, &got[ticks]) == 1) {
        ticks++;
    }
    TEST_ASSERT_EQUAL(sizeof want / sizeof want[0], ticks);
    TEST_ASSERT_EQUAL_INT32_ARRAY(want, got, ticks);
}

/* SPDX-License-Identifier: MIT */
/* The node: sequences of encoder frames and bus events, each row of the fault table, Status and Reset. */
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "fault_table.h"
#include "node_talk.h"

static dahl_plan_t plan;

void setUp(void)
{
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_prepare(&plan, &params));
    talk_begin();
}

void tearDown(void)
{
}

/* The names of the counters that grew, in the words of the fault table, optionally with the increments. */
static void grown(const dahl_node_counts_t *before, char *text, bool with_counts)
{
    const dahl_node_counts_t *n = &node.counts;
    const struct {
        const char *name;
        uint32_t by;
    } counters[] = {{"ok", n->ok - before->ok},
                    {"repeated", n->repeated - before->repeated},
                    {"lost", n->lost - before->lost},
                    {"wrong_sequence", n->wrong_sequence - before->wrong_sequence},
                    {"crc", n->crc - before->crc},
                    {"format", n->format - before->format},
                    {"invalid", n->invalid - before->invalid},
                    {"jump", n->jump - before->jump},
                    {"stale", n->stale - before->stale},
                    {"rearm", n->rearm - before->rearm},
                    {"bus_off", n->bus_off - before->bus_off}};
    const char *start = text;
    text[0] = '\0';
    for (size_t i = 0; i < sizeof counters / sizeof counters[0]; i++) {
        if (counters[i].by > 0) {
            text += sprintf(text, "%s%s", text != start ? ", " : "", counters[i].name);
            text += with_counts ? sprintf(text, " %u", (unsigned)counters[i].by) : 0;
        }
    }
}

/* --- stories: sequences of frames and events ----------------------------------------------------------------------- */

enum { FRAME, INVALID_COUNT, CORRUPT, CUT, FLAGGED, BUS_OFF, WAIT, LIMIT, SET, RESET };
enum { NO_ANSWER = -1, BEATS = 14 };

typedef struct {
    int kind;
    uint32_t counter; /* SET: the parameter; RESET: what */
    int32_t count;    /* WAIT: us; LIMIT: counts; SET: the value */
    int answer;       /* state in the answer */
    int32_t travel;   /* FLAGGED: the flags of the frame */
} beat_t;

#define ANSWERED(counter, count, state, travel) {FRAME, counter, count, DAHL_FRAMES_##state, travel}
#define UNANSWERED(counter, count) {FRAME, counter, count, NO_ANSWER, 0}
#define INVALID(counter, count) {INVALID_COUNT, counter, count, NO_ANSWER, 0}
#define CORRUPTS(counter) {CORRUPT, counter, 0, NO_ANSWER, 0}
#define WAITS(us) {WAIT, 0, us, NO_ANSWER, 0}
#define GOES_OFF {BUS_OFF, 0, 0, NO_ANSWER, 0}
#define SETS(param, value) {SET, DAHL_FRAMES_PARAM_##param, value, NO_ANSWER, 0}
#define RESETS(what) {RESET, what, 0, NO_ANSWER, 0}
#define MAY_STEP(counts) {LIMIT, 0, counts, NO_ANSWER, 0}
#define SEEN(state) (1u << DAHL_FRAMES_##state)

typedef struct {
    const char *name, *counted;
    size_t length;
    beat_t beats[BEATS];
    uint32_t errors;
} story_t;

static const story_t STORIES[] = {
    {"bad and repeated frames do not end a row out of sequence, an answer does", "ok 6, repeated 1, wrong_sequence 6, crc 1", 14,
     {ANSWERED(0, 0, INIT, 0), UNANSWERED(5, 900), CORRUPTS(6), UNANSWERED(6, 900), UNANSWERED(0, 0), ANSWERED(7, 900, WRONG_SEQUENCE, 0), ANSWERED(8, 900, OK, 0),
      ANSWERED(9, 900, OK, 0), ANSWERED(10, 900, OK, 0), ANSWERED(11, 900, OK, 0), ANSWERED(12, 900, OK, 0), UNANSWERED(8, 5), UNANSWERED(9, 5),
      ANSWERED(10, 5, WRONG_SEQUENCE, 0)},
     SEEN(REPEATED) | SEEN(WRONG_SEQUENCE) | SEEN(CRC)},
    {"an invalid count is no starting point", "ok 1, wrong_sequence 3, invalid 1", 5,
     {INVALID(1, 9999), ANSWERED(2, 7, INIT, 0), UNANSWERED(8, 5000), INVALID(9, 9999), ANSWERED(10, 5001, WRONG_SEQUENCE, 0)},
     SEEN(WRONG_SEQUENCE) | DAHL_FRAMES_ERROR_INVALID},
    {"the last microsecond of the timeout is not stale", "ok 2", 3,
     {ANSWERED(0, 0, INIT, 0), WAITS(DAHL_NODE_TIMEOUT_US - 1000), ANSWERED(1, 10, OK, 10)}, 0},
    {"a clock that goes back by a millisecond is no timeout", "ok 3", 4,
     {ANSWERED(0, 100, INIT, 0), ANSWERED(1, 110, OK, 10), WAITS(-2000), ANSWERED(2, 120, OK, 10)}, 0},
    {"a bad frame breaks the row after a timeout", "ok 2, crc 1, stale 1, rearm 4", 8,
     {ANSWERED(0, 0, INIT, 0), WAITS(DAHL_NODE_TIMEOUT_US), UNANSWERED(2, 0), UNANSWERED(3, 0), CORRUPTS(4), UNANSWERED(4, 0), UNANSWERED(5, 0), ANSWERED(6, 0, STALE, 0)},
     SEEN(STALE) | SEEN(CRC)},
    {"a row out of sequence beyond the limit is a new start without travel", "ok 3, wrong_sequence 3", 7,
     {MAY_STEP(100), ANSWERED(0, 0, INIT, 0), ANSWERED(1, 60, OK, 60), UNANSWERED(12, 5000000), UNANSWERED(13, 5000010), ANSWERED(14, 5000020, WRONG_SEQUENCE, 0),
      ANSWERED(15, 5000030, OK, 10)},
     SEEN(WRONG_SEQUENCE)},
    {"the step limit holds backward too, for each started millisecond", "ok 5, jump 2", 9,
     {MAY_STEP(100), ANSWERED(0, 0, INIT, 0), ANSWERED(1, -100, OK, -100), UNANSWERED(2, -100 - 101), UNANSWERED(3, INT32_MIN), ANSWERED(4, -150, OK, -50),
      ANSWERED(5, -151, OK, -1), WAITS(1), ANSWERED(6, -351, OK, -200)},
     DAHL_FRAMES_ERROR_JUMP},
    /* The largest limit times three frames is more than 32 bits hold. */
    {"the largest step limit allows any travel of two frames", "ok 3, lost 2, jump 1", 5,
     {MAY_STEP(INT32_MAX), ANSWERED(0, 0, INIT, 0), UNANSWERED(1, INT32_MIN), ANSWERED(2, 0, OK, 0), ANSWERED(5, INT32_MIN, LOST, INT32_MIN)},
     SEEN(LOST) | DAHL_FRAMES_ERROR_JUMP},
    /* Without a limit a new start has no travel, even at the same count. */
    {"a step limit of one count and of 0, which is no limit", "ok 4, lost 4, wrong_sequence 5, jump 1", 12,
     {MAY_STEP(1), ANSWERED(11, 0, INIT, 0), ANSWERED(0, 0, LOST, 0), UNANSWERED(1, 2), ANSWERED(2, 1, OK, 1), UNANSWERED(12, 2), UNANSWERED(13, 2), ANSWERED(14, 2, LOST, 1),
      MAY_STEP(0), UNANSWERED(7, 2), UNANSWERED(8, 2), ANSWERED(9, 2, WRONG_SEQUENCE, 0)},
     SEEN(LOST) | SEEN(WRONG_SEQUENCE) | DAHL_FRAMES_ERROR_JUMP},
    /* Its id 0x100, controller restarted, is that of an EncoderState. */
    {"an error frame is not a frame of the encoder", "ok 3, rearm 2, bus_off 1", 9,
     {ANSWERED(0, 0, INIT, 0), {FLAGGED, 1, 70, NO_ANSWER, DAHL_CAN_FRAME_ERROR}, ANSWERED(1, 5, OK, 5), GOES_OFF,
      WAITS(DAHL_NODE_TIMEOUT_US), UNANSWERED(4, 0), {FLAGGED, 4, 70, NO_ANSWER, DAHL_CAN_FRAME_ERROR}, UNANSWERED(5, 0), ANSWERED(6, 0, STALE, 0)},
     SEEN(STALE)},
    {"a bus-off ends after the timeout, to the millisecond", "ok 3, rearm 5, bus_off 1", 10,
     {ANSWERED(0, 0, INIT, 0), ANSWERED(1, 300, OK, 300), GOES_OFF, WAITS(DAHL_NODE_TIMEOUT_US - 4000), UNANSWERED(4, 500), UNANSWERED(5, 510), UNANSWERED(6, 520),
      UNANSWERED(4, 500), UNANSWERED(5, 510), ANSWERED(6, 520, STALE, 0)},
     SEEN(STALE)},
    {"a longer timeout blocks the node again and restarts the row", "ok 2, rearm 5, bus_off 1", 11,
     {ANSWERED(0, 0, INIT, 0), GOES_OFF, WAITS(DAHL_NODE_TIMEOUT_US), UNANSWERED(4, 500), UNANSWERED(5, 510), SETS(TIMEOUT, 60000), UNANSWERED(6, 520),
      SETS(TIMEOUT, 100), UNANSWERED(6, 520), UNANSWERED(7, 530), ANSWERED(8, 540, STALE, 0)},
     SEEN(STALE)},
    {"an answer resets the number of bus-offs", "ok 2, rearm 4, bus_off 6", 14,
     {GOES_OFF, GOES_OFF, GOES_OFF, WAITS(DAHL_NODE_TIMEOUT_US), UNANSWERED(4, 0), UNANSWERED(5, 0), ANSWERED(6, 0, STALE, 0), GOES_OFF, GOES_OFF, GOES_OFF,
      WAITS(DAHL_NODE_TIMEOUT_US), UNANSWERED(4, 0), UNANSWERED(5, 0), ANSWERED(6, 0, STALE, 0)},
     SEEN(STALE)},
    {"the fourth bus-off is latched until a restart", "ok 1, rearm 6, bus_off 4", 14,
     {GOES_OFF, GOES_OFF, GOES_OFF, GOES_OFF, WAITS(10 * DAHL_NODE_TIMEOUT_US), UNANSWERED(4, 0), UNANSWERED(5, 0), UNANSWERED(6, 0),
      RESETS(DAHL_FRAMES_RESET_ERRORS), UNANSWERED(7, 0), UNANSWERED(8, 0), UNANSWERED(9, 0), RESETS(DAHL_FRAMES_RESET_RESTART), ANSWERED(7, 530, INIT, 0)},
     0},
    {"a restart resets the number of bus-offs", "ok 1, rearm 2, bus_off 7", 12,
     {GOES_OFF, GOES_OFF, GOES_OFF, GOES_OFF, RESETS(DAHL_FRAMES_RESET_RESTART), GOES_OFF, GOES_OFF, GOES_OFF,
      WAITS(DAHL_NODE_TIMEOUT_US), UNANSWERED(4, 0), UNANSWERED(5, 0), ANSWERED(6, 0, STALE, 0)},
     SEEN(STALE)},
};

static dahl_can_frame_t frame_of(const beat_t *beat)
{
    dahl_can_frame_t frame = encoder_frame(beat->counter, beat->count, beat->kind != INVALID_COUNT);
    frame.data[3] ^= beat->kind == CORRUPT ? 0x10 : 0;
    frame.length = beat->kind == CUT ? 7 : 8;
    frame.flags = beat->kind == FLAGGED ? (uint8_t)beat->travel : 0;
    if (beat->kind == BUS_OFF) {
        frame = (dahl_can_frame_t){.id = DAHL_CAN_ERROR_BUS_OFF, .flags = DAHL_CAN_FRAME_ERROR, .length = 8};
    }
    return frame;
}

static bool act(const beat_t *beat)
{
    dahl_can_frame_t frame = frame_of(beat);
    switch (beat->kind) {
    case WAIT: now_us += (uint32_t)beat->count; return false;
    case LIMIT: node.max_step = (uint32_t)beat->count; return false;
    case SET: TEST_ASSERT_TRUE(set_param((uint8_t)beat->counter, (uint32_t)beat->count)); return false;
    case RESET: (void)reset((uint8_t)beat->counter); return false;
    default: return give(&frame);
    }
}

/* The bristle moved by the travel as in the library, and the answer has that torque. */
static void play_beat(const beat_t *beat, dahl_state_t *reference, const char *name)
{
    TEST_ASSERT_EQUAL_MESSAGE(beat->answer != NO_ANSWER, act(beat), name);
    int32_t torque_q30 = dahl_step_counts_q30(&plan, reference, beat->kind == FLAGGED ? 0 : beat->travel);
    TEST_ASSERT_TRUE_MESSAGE(reference->w == node.bearing.w, name);
    if (beat->answer != NO_ANSWER) {
        TEST_ASSERT_EQUAL_MESSAGE(beat->answer, answer.state, name);
        TEST_ASSERT_EQUAL_MESSAGE(beat->counter, answer.echo, name);
        TEST_ASSERT_EQUAL_MESSAGE(torque_q30, answer.torque_q30, name);
    }
}

static void test_each_story_has_its_answers_counts_and_errors(void)
{
    char counted[128];
    for (size_t i = 0; i < sizeof STORIES / sizeof STORIES[0]; i++) {
        const story_t *story = &STORIES[i];
        const dahl_node_counts_t none = {0};
        dahl_state_t reference = {0};
        setUp();
        for (size_t k = 0; k < story->length; k++) {
            play_beat(&story->beats[k], &reference, story->name);
        }
        grown(&none, counted, true);
        TEST_ASSERT_EQUAL_STRING_MESSAGE(story->counted, counted, story->name);
        TEST_ASSERT_EQUAL_HEX8_MESSAGE(story->errors, node.errors, story->name);
    }
}

/* A row of 256 invalid counts still counts as a row, so the next good frame is a new start. 300 bus-offs stay latched. */
static void test_rows_and_bus_offs_do_not_overflow_a_byte(void)
{
    uint32_t next = 15;
    TEST_ASSERT_TRUE(feed(0, 0));
    for (uint32_t i = 0; i < 256; i++, next++) { /* one behind, which continues the row; then one ahead */
        dahl_can_frame_t behind = encoder_frame(next, 900, false), ahead = encoder_frame(next + 2, 900, false);
        TEST_ASSERT_FALSE(give(&behind) || give(&ahead));
        now_us -= 2000;
    }
    TEST_ASSERT_TRUE(node.counts.wrong_sequence == 256 && node.counts.invalid == 256);
    TEST_ASSERT_TRUE(feed(next, 900) && answer.state == DAHL_FRAMES_WRONG_SEQUENCE);
    for (uint32_t i = 1; i <= 300; i++) {
        dahl_node_bus_off(&node, now_us);
        now_us += i < DAHL_NODE_OFF_MAX ? 0 : DAHL_NODE_TIMEOUT_US;
        TEST_ASSERT_FALSE(feed(4, 500) || feed(5, 510) || feed(6, 520));
    }
    TEST_ASSERT_EQUAL(300, node.counts.bus_off);
}

/* The clock wraps after 71 minutes. */
static void test_a_bus_off_does_not_block_again_after_the_clock_wraps(void)
{
    dahl_can_frame_t out;
    dahl_node_bus_off(&node, now_us);
    (void)dahl_node_tick(&node, now_us, &out);
    TEST_ASSERT_FALSE(feed(4, 500) || feed(5, 510) || feed(6, 520)); /* a tick does not shorten the timeout */
    for (uint32_t ms = 0; ms < 4294967u + 10; ms++) {
        now_us += 1000;
        (void)dahl_node_tick(&node, now_us, &out);
    }
    TEST_ASSERT_TRUE(!feed(4, 500) && !feed(5, 510) && feed(6, 520));
}

/* --- Status -------------------------------------------------------------------------------------------------------- */

/* If the period is 0, Status is sent only on news: power-on, a timeout, a bus-off. */
static void test_status_is_sent_every_100_ms_or_on_news(void)
{
    dahl_can_frame_t out;
    dahl_node_status_t status;
    uint32_t sent = 0;
    node.status_us = 0;
    TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us, &out)); /* power-on */
    node.status_us = DAHL_NODE_STATUS_US;
    for (uint32_t i = 0; i < 10000; i++) {
        TEST_ASSERT_TRUE(feed(i, 0));
        sent += dahl_node_tick(&node, now_us, &out) ? 1u : 0u;
    }
    TEST_ASSERT_EQUAL(100, sent);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_STATUS, 0));
    for (uint32_t i = 10000; i < 11000; i++) {
        TEST_ASSERT_TRUE(feed(i, 0) && !dahl_node_tick(&node, now_us, &out));
    }
    now_us += DAHL_NODE_TIMEOUT_US + 1;
    TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us, &out));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_GOOD, dahl_frames_unpack_status(&out, &status));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_STALE, status.state);
    TEST_ASSERT_TRUE(status.version_major == DAHL_VERSION_MAJOR && status.version_minor == DAHL_VERSION_MINOR);
    TEST_ASSERT_FALSE(dahl_node_tick(&node, now_us + 1000000, &out));
    dahl_node_bus_off(&node, now_us);
    TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us, &out));
}

/* After power-on the first tick sends Status, unless a Reset has been answered by it. Other answers are no Status. */
static void test_the_first_tick_sends_status_unless_a_reset_was_answered(void)
{
    for (uint8_t first = 0; first < 4; first++) { /* no frame, EncoderState, ParamWrite, Reset */
        dahl_can_frame_t out;
        setUp();
        now_us = 0; /* no period has passed */
        TEST_ASSERT_TRUE(first != 1 || feed(0, 0));
        TEST_ASSERT_TRUE(first != 2 || set_param(DAHL_FRAMES_PARAM_GAIN, 1));
        if (first == 3) {
            (void)reset(DAHL_FRAMES_RESET_ERRORS);
        }
        TEST_ASSERT_EQUAL(first != 3, dahl_node_tick(&node, now_us, &out));
        TEST_ASSERT_FALSE(dahl_node_tick(&node, now_us + DAHL_NODE_STATUS_US - 1, &out));
        TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us + DAHL_NODE_STATUS_US, &out));
    }
}

/* --- Reset --------------------------------------------------------------------------------------------------------- */

static void spoil(void)
{
    dahl_can_frame_t corrupt = encoder_frame(5, 0, true), out;
    corrupt.data[3] ^= 1;
    TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us, &out));
    TEST_ASSERT_TRUE(feed(0, 0) && feed(2, 5000) && !feed(2, 5000) && !give(&corrupt));
    dahl_node_bus_off(&node, now_us);
    now_us += DAHL_NODE_TIMEOUT_US;
    TEST_ASSERT_FALSE(feed(9, 6000) || feed(10, 6000));
}

/* All frames that a node sends during a fixed story. */
static size_t story(dahl_can_frame_t said[40])
{
    size_t count = 0;
    for (uint32_t i = 0; i < 20; i++) {
        dahl_can_frame_t frame = encoder_frame(i % 7 == 3 ? 0 : i, (int32_t)(i * i), true);
        now_us += 1000;
        count += dahl_node_tick(&node, now_us, &said[count]) ? 1u : 0u;
        count += dahl_node_receive(&node, &frame, now_us, &said[count]) ? 1u : 0u;
    }
    return count;
}

static void test_a_restart_equals_power_on(void)
{
    dahl_can_frame_t fresh[40], again[40], first, restarted;
    const uint32_t began_us = now_us;
    node.gain = 1000;
    node.ramp_us = 5000;
    node.gain_now = 0;
    TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us, &first)); /* a restart is answered by the same Status */
    const size_t count = story(fresh);
    setUp();
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_GAIN, 1000) && set_param(DAHL_FRAMES_PARAM_RAMP, 5));
    spoil();
    now_us = began_us;
    restarted = reset(DAHL_FRAMES_RESET_RESTART);
    TEST_ASSERT_EQUAL_MEMORY(&first, &restarted, sizeof first);
    TEST_ASSERT_EQUAL(count, story(again));
    TEST_ASSERT_EQUAL_MEMORY(fresh, again, count * sizeof fresh[0]);
}

static void test_bad_requests_are_counted_and_have_no_effect(void)
{
    const dahl_params_t bad = {.sigma0 = -1.0f, .Fc = 0.5f, .theta_per_count = 1e-4f};
    const dahl_param_write_t write = {.value = 5, .param = DAHL_FRAMES_PARAM_GAIN, .write = DAHL_FRAMES_PARAM_WRITE};
    dahl_can_frame_t frames[2], out;
    dahl_frames_pack_param_write(&frames[0], NUMBER, &write);
    dahl_frames_pack_reset(&frames[1], NUMBER, &(dahl_node_reset_t){.what = DAHL_FRAMES_RESET_RESTART});
    TEST_ASSERT_TRUE(feed(0, 0) && feed(1, 300));
    dahl_node_t before = node;
    for (uint32_t i = 0; i < 2; i++) {
        frames[i].data[7] ^= 0x20;
        TEST_ASSERT_FALSE(dahl_node_receive(&node, &frames[i], now_us, &out));
        frames[i].length = 6;
        TEST_ASSERT_FALSE(dahl_node_receive(&node, &frames[i], now_us, &out));
        TEST_ASSERT_TRUE(node.counts.crc == i + 1 && node.counts.format == i + 1);
    }
    TEST_ASSERT_EQUAL_HEX8(SEEN(CRC) | DAHL_FRAMES_ERROR_FORMAT, node.errors);
    before.counts = node.counts;
    before.errors = node.errors;
    before.state = node.state;
    TEST_ASSERT_EQUAL_MEMORY(&before, &node, sizeof node);
    TEST_ASSERT_EQUAL(DAHL_ERR_PARAM, dahl_node_init(&node, &bad, NUMBER));
    TEST_ASSERT_EQUAL_MEMORY(&before, &node, sizeof node);
    TEST_ASSERT_TRUE(feed(2, 310));
}

/* --- the fault table, row by row ---------------------------------------------------------------------------------- */

#define SENT(counter, count) {FRAME, counter, count, 0, 0}
#define FLAGGED_AS(flag) {FLAGGED, 1, 70, 0, flag}
#define THIRD_OF_OTHERS SENT(0, 0), SENT(9, 60), SENT(10, 65), SENT(11, 70)
#define TIMES_OUT WAITS(DAHL_NODE_TIMEOUT_US + 1)
#define THREE_MORE SENT(1, 60), SENT(2, 65), SENT(3, 70)

/* Each sequence ends with the beat that the row is about. */
static const beat_t play_FIRST[] = {SENT(7, 70)};
static const beat_t play_NEXT[] = {SENT(0, 0), SENT(1, 70)};
static const beat_t play_GAP[] = {SENT(0, 0), SENT(3, 70)};
static const beat_t play_LONG_GAP[] = {MAY_STEP(100), SENT(0, 0), SENT(8, 70)};
static const beat_t play_AGAIN[] = {SENT(0, 0), SENT(0, 70)};
static const beat_t play_OTHER[] = {SENT(0, 0), SENT(9, 70)};
static const beat_t play_FAR[] = {MAY_STEP(10), SENT(0, 0), SENT(1, 70000)};
static const beat_t play_FAR_GAP[] = {MAY_STEP(10), SENT(0, 0), SENT(8, 70000)};
static const beat_t play_THIRD[] = {THIRD_OF_OTHERS};
static const beat_t play_THIRD_FAR[] = {MAY_STEP(10), SENT(0, 0), SENT(1, 70000), SENT(2, 70005), SENT(3, 70010)};
static const beat_t play_THIRD_NEAR[] = {MAY_STEP(100), THIRD_OF_OTHERS};
static const beat_t play_DISOWNED[] = {SENT(0, 0), INVALID(1, 70)};
static const beat_t play_DISOWNED_GAP[] = {SENT(0, 0), INVALID(3, 70)};
static const beat_t play_DISOWNED_FIRST[] = {INVALID(1, 70)};
static const beat_t play_BAD_CRC[] = {SENT(0, 0), CORRUPTS(1)};
static const beat_t play_BAD_LENGTH[] = {SENT(0, 0), {CUT, 1, 70, 0, 0}};
static const beat_t play_EXTENDED[] = {SENT(0, 0), FLAGGED_AS(DAHL_CAN_FRAME_EXTENDED)};
static const beat_t play_REMOTE[] = {SENT(0, 0), FLAGGED_AS(DAHL_CAN_FRAME_REMOTE)};
static const beat_t play_FD[] = {SENT(0, 0), FLAGGED_AS(DAHL_CAN_FRAME_FD)};
static const beat_t play_SILENCE[] = {SENT(0, 0), TIMES_OUT};
static const beat_t play_BACK_TWO[] = {SENT(0, 0), TIMES_OUT, SENT(1, 60), SENT(2, 65)};
static const beat_t play_BACK_THREE[] = {SENT(0, 0), TIMES_OUT, THREE_MORE};
static const beat_t play_GONE_OFF[] = {SENT(0, 0), GOES_OFF};
static const beat_t play_OFF_HELD[] = {SENT(0, 0), GOES_OFF, THREE_MORE};
static const beat_t play_OFF_BACK[] = {SENT(0, 0), GOES_OFF, TIMES_OUT, THREE_MORE};
static const beat_t play_OFF_LATCHED[] = {SENT(0, 0), GOES_OFF, GOES_OFF, GOES_OFF, GOES_OFF, WAITS(10 * DAHL_NODE_TIMEOUT_US),
                                         THREE_MORE};

typedef struct {
    const char *name, *counted, *bristle;
    const beat_t *beats;
    size_t length;
    dahl_frames_state_t state;
    bool answered;
} row_t;

#define LENGTH(beats) (sizeof(beats) / sizeof(beats)[0])
#define ROW(id, frame, counted, state, bristle, answered) \
    {#id, counted, bristle, play_##id, LENGTH(play_##id), DAHL_FRAMES_##state, answered},
#define COUNTER_ROW(id, counter, max_step, third, counted, state, bristle, answered) \
    ROW(id, counter, counted, state, bristle, answered)
static const row_t rows[] = {FAULT_COUNTERS(COUNTER_ROW) FAULT_EVENTS(ROW)};

static void check_row(const row_t *row)
{
    char counted[128];
    dahl_can_frame_t out;
    dahl_node_status_t status;
    setUp();
    for (size_t i = 0; i + 1 < row->length; i++) {
        (void)act(&row->beats[i]);
    }
    dahl_node_t before = node;
    bool answered = act(&row->beats[row->length - 1]);
    node.urgent = true;
    TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us, &out));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_GOOD, dahl_frames_unpack_status(&out, &status));
    grown(&before.counts, counted, false);
    TEST_ASSERT_EQUAL_STRING_MESSAGE(row->counted, counted, row->name);
    TEST_ASSERT_EQUAL_MESSAGE(row->state, status.state, row->name);
    TEST_ASSERT_EQUAL_STRING_MESSAGE(row->bristle, before.bearing.w == node.bearing.w ? "kept" : "moved", row->name);
    TEST_ASSERT_EQUAL_MESSAGE(row->answered, answered, row->name);
}

static void test_each_row_of_the_fault_table(void)
{
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        check_row(&rows[i]);
    }
}

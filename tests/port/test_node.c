/* SPDX-License-Identifier: MIT */
/* The node: each row of the fault table, and what else its header says. */
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "dahl_node.h"
#include "fault_table.h"
#include "random.h"

enum { NUMBER = 3 };

static const dahl_params_t params = {.sigma0 = 50.0f, .Fc = 0.5f, .theta_per_count = 1e-4f};
static dahl_plan_t plan;
static dahl_node_t node;
static uint32_t now_us;

#define GAIN_STEP_Q30 ((1 << 30) / (int32_t)DAHL_NODE_ONE) /* what one step of the gain moves of a full torque */

static dahl_friction_torque_t answer;

void setUp(void)
{
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_prepare(&plan, &params));
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_init(&node, &params, NUMBER));
    now_us = 0xFFFF0000u; /* the clock wraps in every longer test */
}

void tearDown(void)
{
}

static dahl_can_frame_t encoder_frame(uint32_t counter, int32_t count)
{
    dahl_encoder_state_t state = {.count = count, .counter = counter & 0x0F, .valid = true};
    dahl_can_frame_t frame;
    dahl_frames_pack_encoder(&frame, NUMBER, &state);
    return frame;
}

/* Give it a frame, 1 ms later. True: it answered, the answer is in `answer`. */
static bool give(const dahl_can_frame_t *frame)
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

static bool feed(uint32_t counter, int32_t count)
{
    dahl_can_frame_t frame = encoder_frame(counter, count);
    return give(&frame);
}

static dahl_node_status_t status_now(void)
{
    dahl_can_frame_t out;
    dahl_node_status_t status;
    now_us += DAHL_NODE_STATUS_US;
    TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us, &out));
    TEST_ASSERT_EQUAL_HEX32(DAHL_FRAMES_ID_STATUS | NUMBER, out.id);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_GOOD, dahl_frames_unpack_status(&out, &status));
    return status;
}

/* Names of the counters that grew, as the fault table has them; by how much where that is asked for. */
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

/* --- stories: frames of an encoder, and what comes of each -------------------------------------------------------- */

enum { FRAME, DISOWNED, CORRUPT, CUT, FLAGGED, BUS_OFF, WAIT, LIMIT };
enum { NO_ANSWER = -1, BEATS = 16 };

typedef struct {
    int kind;
    uint32_t counter;
    int32_t count; /* of a WAIT the us, of a LIMIT the counts */
    int answer;    /* state in the answer */
    int32_t travel; /* of a FLAGGED frame its flags */
} beat_t;

#define IS(counter, count, state, travel) {FRAME, counter, count, DAHL_FRAMES_##state, travel}
#define NOT(counter, count) {FRAME, counter, count, NO_ANSWER, 0}
#define DISOWNS(counter, count) {DISOWNED, counter, count, NO_ANSWER, 0}
#define SPOILS(counter) {CORRUPT, counter, 0, NO_ANSWER, 0}
#define WAITS(us) {WAIT, 0, us, NO_ANSWER, 0}
#define GOES_OFF {BUS_OFF, 0, 0, NO_ANSWER, 0}
#define MAY_STEP(counts) {LIMIT, 0, counts, NO_ANSWER, 0}
#define SEEN(state) (1u << DAHL_FRAMES_##state)

typedef struct {
    const char *name, *counted;
    size_t length;
    beat_t beats[BEATS];
    uint32_t errors;
} story_t;

static const story_t STORIES[] = {
    {"the first frame is a starting point and moves nothing", "ok 1", 1, {IS(9, 123456, INIT, 0)}, 0},
    {"the count wraps at 32 bits without a jump", "ok 3", 3,
     {IS(0, INT32_MAX - 5, INIT, 0), IS(1, INT32_MIN + 4, OK, 10), IS(2, INT32_MAX, OK, -5)}, 0},
    {"a repeated frame is counted and not used", "ok 3, repeated 1", 4,
     {IS(0, 0, INIT, 0), IS(1, 50, OK, 50), NOT(1, 90), IS(2, 60, OK, 10)}, SEEN(REPEATED)},
    {"one or two missing frames cost nothing", "ok 4, lost 3", 4,
     {IS(14, 0, INIT, 0), IS(0, 40, LOST, 40), IS(3, 100, LOST, 60), IS(4, 100, OK, 0)}, SEEN(LOST)},
    {"a good frame between two out of sequence ends the doubt", "ok 3, wrong_sequence 2", 5,
     {IS(0, 0, INIT, 0), NOT(8, 5000), IS(1, 20, OK, 20), NOT(9, 5010), IS(2, 30, OK, 10)}, SEEN(WRONG_SEQUENCE)},
    {"three in a row are a new start without travel", "ok 3, wrong_sequence 3", 6,
     {IS(0, 0, INIT, 0), IS(1, 30, OK, 30), NOT(8, 5000), NOT(9, 5005), IS(10, 5010, WRONG_SEQUENCE, 0), IS(11, 5011, OK, 1)},
     SEEN(WRONG_SEQUENCE)},
    /* Up, down or with a gap: only each counter plus 1 makes a row, and three make it long enough. */
    {"frames that do not follow each other are no new start", "ok 1, wrong_sequence 10", 11,
     {IS(0, 0, INIT, 0), NOT(4, 900), NOT(8, 900), NOT(14, 900), NOT(9, 900), NOT(8, 900), NOT(7, 900), NOT(8, 900), NOT(10, 900),
      NOT(11, 900), IS(12, 900, WRONG_SEQUENCE, 0)},
     SEEN(WRONG_SEQUENCE)},
    /* What one row has used up does not count for the next: late frames that go on where it ended are not believed at once. */
    {"after a new start doubt begins anew", "ok 6, wrong_sequence 6", 12,
     {IS(0, 0, INIT, 0), NOT(5, 900), NOT(6, 900), IS(7, 900, WRONG_SEQUENCE, 0), IS(8, 900, OK, 0), IS(9, 900, OK, 0),
      IS(10, 900, OK, 0), IS(11, 900, OK, 0), IS(12, 900, OK, 0), NOT(8, 5), NOT(9, 5), IS(10, 5, WRONG_SEQUENCE, 0)},
     SEEN(WRONG_SEQUENCE)},
    /* The row is three long, but its third count is one that the encoder disowns: the fourth is the new start. */
    {"a disowned count is no new start but does not break the row", "ok 3, wrong_sequence 4", 7,
     {IS(0, 0, INIT, 0), IS(1, 40, OK, 40), NOT(5, 701), NOT(6, 702), DISOWNS(7, 703), IS(8, 704, WRONG_SEQUENCE, 0),
      IS(9, 714, OK, 10)},
     SEEN(WRONG_SEQUENCE)},
    {"a count that the encoder disowns is not used, and is no jump", "ok 2, invalid 1", 4,
     {MAY_STEP(10), IS(0, 0, INIT, 0), DISOWNS(1, 9999), IS(2, 7, OK, 7)}, DAHL_FRAMES_ERROR_INVALID},
    {"an invalid count is no starting point", "ok 1, wrong_sequence 3, invalid 1", 5,
     {DISOWNS(1, 9999), IS(2, 7, INIT, 0), NOT(8, 5000), DISOWNS(9, 9999), IS(10, 5001, WRONG_SEQUENCE, 0)},
     SEEN(WRONG_SEQUENCE) | DAHL_FRAMES_ERROR_INVALID},
    {"wrong CRC and form are not used, and the next good one goes on", "ok 2, crc 1, format 1", 4,
     {IS(0, 0, INIT, 0), SPOILS(1), {CUT, 1, 500, NO_ANSWER, 0}, IS(1, 5, OK, 5)}, SEEN(CRC) | DAHL_FRAMES_ERROR_FORMAT},
    {"age is seen without a tick too", "ok 2, stale 1, rearm 2", 5,
     {IS(0, 0, INIT, 0), WAITS(DAHL_NODE_TIMEOUT_US), NOT(1, 4000), NOT(2, 4000), IS(3, 4000, STALE, 0)}, SEEN(STALE)},
    {"the last microsecond is not stale", "ok 2", 3,
     {IS(0, 0, INIT, 0), WAITS(DAHL_NODE_TIMEOUT_US - 1000), IS(1, 10, OK, 10)}, 0},
    /* By a millisecond, as an emulated clock may. */
    {"a clock that goes back is no silence", "ok 3", 4,
     {IS(0, 100, INIT, 0), IS(1, 110, OK, 10), WAITS(-2000), IS(2, 120, OK, 10)}, 0},
    {"a bad frame breaks the row after a timeout", "ok 2, crc 1, stale 1, rearm 4", 8,
     {IS(0, 0, INIT, 0), WAITS(DAHL_NODE_TIMEOUT_US), NOT(2, 0), NOT(3, 0), SPOILS(4), NOT(4, 0), NOT(5, 0), IS(6, 0, STALE, 0)},
     SEEN(STALE) | SEEN(CRC)},
    {"a disowned count breaks the row after a timeout", "ok 2, invalid 1, stale 1, rearm 4", 8,
     {IS(0, 0, INIT, 0), WAITS(DAHL_NODE_TIMEOUT_US), NOT(2, 0), NOT(3, 0), DISOWNS(9, 0), NOT(4, 0), NOT(5, 0),
      IS(6, 0, STALE, 0)},
     SEEN(STALE) | DAHL_FRAMES_ERROR_INVALID},
    /* A row that has begun while the node was primed: a corrupt frame does not break it, silence does. */
    {"what breaks a row", "ok 2, wrong_sequence 5, crc 1, rearm 2, bus_off 1", 12,
     {IS(0, 0, INIT, 0), NOT(5, 900), NOT(6, 900), SPOILS(7), IS(7, 900, WRONG_SEQUENCE, 0), NOT(12, 900), NOT(13, 900), GOES_OFF,
      WAITS(DAHL_NODE_TIMEOUT_US), NOT(14, 900), NOT(15, 900), IS(0, 900, STALE, 0)},
     SEEN(WRONG_SEQUENCE) | SEEN(CRC) | SEEN(STALE)},
    {"with a step limit a glitch is not used", "ok 2, jump 2", 5,
     {MAY_STEP(100), IS(0, 0, INIT, 0), NOT(1, 1000000), IS(2, 180, OK, 180), NOT(3, 180 + 201)}, DAHL_FRAMES_ERROR_JUMP},
    {"the step limit holds backward too", "ok 4, jump 2", 7,
     {MAY_STEP(100), IS(0, 0, INIT, 0), IS(1, -100, OK, -100), NOT(2, -100 - 101), NOT(3, INT32_MIN), IS(4, -150, OK, -50),
      IS(5, -151, OK, -1)},
     DAHL_FRAMES_ERROR_JUMP},
    /* The largest limit times three frames is more than 32 bits hold. */
    {"the largest step limit allows every way of two frames", "ok 3, lost 2, jump 1", 5,
     {MAY_STEP(INT32_MAX), IS(0, 0, INIT, 0), NOT(1, INT32_MIN), IS(2, 0, OK, 0), IS(5, INT32_MIN, LOST, INT32_MIN)},
     SEEN(LOST) | DAHL_FRAMES_ERROR_JUMP},
    /* A limit of one count is a limit; without one, not even the same count makes a new start a move. */
    {"a step limit of one and of none", "ok 4, lost 4, wrong_sequence 5, jump 1", 12,
     {MAY_STEP(1), IS(11, 0, INIT, 0), IS(0, 0, LOST, 0), NOT(1, 2), IS(2, 1, OK, 1), NOT(12, 2), NOT(13, 2), IS(14, 2, LOST, 1),
      MAY_STEP(0), NOT(7, 2), NOT(8, 2), IS(9, 2, WRONG_SEQUENCE, 0)},
     SEEN(LOST) | SEEN(WRONG_SEQUENCE) | DAHL_FRAMES_ERROR_JUMP},
    {"with a step limit a long gap is bridged by the third frame", "ok 2, wrong_sequence 2", 6,
     {MAY_STEP(100), IS(0, 0, INIT, 0), WAITS(20000), NOT(10, 900), NOT(11, 950), IS(12, 1000, LOST, 1000)},
     SEEN(WRONG_SEQUENCE) | SEEN(LOST)},
    {"an encoder that is elsewhere for good is believed without travel", "ok 3, jump 3", 7,
     {MAY_STEP(100), IS(0, 0, INIT, 0), IS(1, 60, OK, 60), NOT(2, 5000000), NOT(3, 5000010), IS(4, 5000020, WRONG_SEQUENCE, 0),
      IS(5, 5000030, OK, 10)},
     SEEN(WRONG_SEQUENCE) | DAHL_FRAMES_ERROR_JUMP},
    {"a row out of sequence and elsewhere is believed without travel", "ok 3, wrong_sequence 3", 7,
     {MAY_STEP(100), IS(0, 0, INIT, 0), IS(1, 60, OK, 60), NOT(12, 5000000), NOT(13, 5000010), IS(14, 5000020, WRONG_SEQUENCE, 0),
      IS(15, 5000030, OK, 10)},
     SEEN(WRONG_SEQUENCE)},
};

static dahl_can_frame_t frame_of(const beat_t *beat)
{
    dahl_encoder_state_t state = {.count = beat->count, .counter = beat->counter & 0x0F, .valid = beat->kind != DISOWNED};
    dahl_can_frame_t frame;
    dahl_frames_pack_encoder(&frame, NUMBER, &state);
    frame.data[3] ^= beat->kind == CORRUPT ? 0x10 : 0;
    frame.length = beat->kind == CUT ? 7 : 8;
    frame.flags = beat->kind == FLAGGED ? (uint8_t)beat->travel : 0;
    if (beat->kind == BUS_OFF) {
        frame = (dahl_can_frame_t){.id = DAHL_CAN_ERROR_BUS_OFF, .flags = DAHL_CAN_FRAME_ERROR, .length = 8};
    }
    return frame;
}

/* True: it was answered. */
static bool act(const beat_t *beat)
{
    dahl_can_frame_t frame = frame_of(beat);
    switch (beat->kind) {
    case WAIT: now_us += (uint32_t)beat->count; return false;
    case LIMIT: node.max_step = (uint32_t)beat->count; return false;
    default: return give(&frame);
    }
}

/* The bristle has moved by the travel, as the library moves it, and the answer says so. */
static void play_beat(const beat_t *beat, dahl_state_t *reference, const char *name)
{
    TEST_ASSERT_EQUAL_MESSAGE(beat->answer != NO_ANSWER, act(beat), name);
    int32_t torque_q30 = dahl_step_counts_q30(&plan, reference, beat->travel);
    TEST_ASSERT_TRUE_MESSAGE(reference->w == node.bearing.w, name);
    if (beat->answer != NO_ANSWER) {
        TEST_ASSERT_EQUAL_MESSAGE(beat->answer, answer.state, name);
        TEST_ASSERT_EQUAL_MESSAGE(beat->counter, answer.echo, name);
        TEST_ASSERT_EQUAL_MESSAGE(torque_q30, answer.torque_q30, name);
    }
}

static void test_each_story(void)
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

static void test_each_frame_moves_by_the_travel_since(void)
{
    uint64_t seed = 1;
    dahl_state_t reference = {0};
    int32_t count = 1000;
    feed(0, count);
    for (uint32_t i = 1; i < 5000; i++) {
        int32_t travel = (int32_t)(random_u32(&seed) % 401) - 200;
        count += travel;
        TEST_ASSERT_TRUE(feed(i, count));
        TEST_ASSERT_EQUAL(dahl_step_counts_q30(&plan, &reference, travel), answer.torque_q30);
        TEST_ASSERT_EQUAL(DAHL_FRAMES_OK, answer.state);
        TEST_ASSERT_EQUAL(i & 0x0F, answer.echo);
        TEST_ASSERT_EQUAL(i & 0x0F, answer.counter);
    }
    TEST_ASSERT_EQUAL(5000, node.counts.ok);
}

/* A row of disowned counts, longer than a byte can say, is a row still: the next good count is believed. */
static void test_a_row_of_any_length_is_one(void)
{
    uint32_t next = 15;
    TEST_ASSERT_TRUE(feed(0, 0));
    for (uint32_t i = 0; i < 256; i++) { /* one behind, which goes on from the last one behind; then one ahead */
        dahl_encoder_state_t state = {.count = 900, .counter = next & 0x0F, .valid = false};
        dahl_can_frame_t frame;
        dahl_frames_pack_encoder(&frame, NUMBER, &state);
        TEST_ASSERT_FALSE(give(&frame));
        TEST_ASSERT_EQUAL(i + 1, node.counts.wrong_sequence);
        now_us = node.good_us;
        state.counter = (next + 2) & 0x0F;
        dahl_frames_pack_encoder(&frame, NUMBER, &state);
        TEST_ASSERT_FALSE(give(&frame));
        TEST_ASSERT_EQUAL(i + 1, node.counts.invalid);
        now_us = node.good_us;
        next++;
    }
    TEST_ASSERT_TRUE(feed(next, 900));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_WRONG_SEQUENCE, answer.state);
}

static void test_bad_and_repeated_frames_do_not_refresh_the_timeout(void)
{
    dahl_can_frame_t corrupt = encoder_frame(1, 500);
    corrupt.data[3] ^= 0x10;
    feed(0, 0);
    for (int i = 0; i < 80; i++) {
        feed(0, 0);
        give(&corrupt);
    }
    dahl_can_frame_t out;
    dahl_node_tick(&node, now_us, &out);
    TEST_ASSERT_EQUAL(1, node.counts.stale);
}

static void test_status_tells_what_happened(void)
{
    dahl_can_frame_t corrupt = encoder_frame(1, 500);
    corrupt.data[0] ^= 0x10;
    dahl_node_status_t status = status_now();
    TEST_ASSERT_EQUAL(DAHL_FRAMES_INIT, status.state);
    TEST_ASSERT_EQUAL(0, status.errors);
    feed(0, 0);
    feed(2, 0);
    feed(2, 0);
    give(&corrupt);
    feed(3, 0);
    status = status_now();
    TEST_ASSERT_EQUAL(1, status.counter);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_OK, status.state);
    TEST_ASSERT_EQUAL_HEX8(1u << DAHL_FRAMES_LOST | 1u << DAHL_FRAMES_REPEATED | 1u << DAHL_FRAMES_CRC, status.errors);
    TEST_ASSERT_EQUAL(1, status.lost);
    TEST_ASSERT_EQUAL(1, status.corrupt);
    TEST_ASSERT_EQUAL(1, status.out_of_step);
    TEST_ASSERT_EQUAL(DAHL_VERSION_MAJOR, status.version_major);
    TEST_ASSERT_EQUAL(DAHL_VERSION_MINOR, status.version_minor);
}

/* Each count in the sum where it belongs, modulo 256. */
static void test_status_adds_up_what_belongs_together(void)
{
    node.counts = (dahl_node_counts_t){.ok = 1000, .repeated = 1, .lost = 256 + 77, .wrong_sequence = 2, .crc = 300, .format = 3,
                                  .invalid = 5000, .jump = 4, .stale = 8, .rearm = 9000, .ignored = 7000, .bus_off = 16};
    dahl_node_status_t status = status_now();
    TEST_ASSERT_EQUAL(77, status.lost);
    TEST_ASSERT_EQUAL(303 - 256, status.corrupt);
    TEST_ASSERT_EQUAL(1 + 2 + 4 + 8 + 16, status.out_of_step);
}

static void test_status_comes_every_100_ms(void)
{
    dahl_can_frame_t out;
    uint32_t sent = 0;
    TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us, &out));
    for (int i = 0; i < 10000; i++) {
        now_us += 1000;
        sent += dahl_node_tick(&node, now_us, &out) ? 1u : 0u;
    }
    TEST_ASSERT_EQUAL(100, sent);
}

/* Without a period Status comes when there is news, and only then: at power-on, a timeout, a bus-off. */
static void test_status_without_a_period_comes_with_news_only(void)
{
    dahl_can_frame_t out;
    dahl_node_status_t status;
    node.status_us = 0;
    TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us, &out));
    feed(0, 0);
    for (uint32_t i = 1; i < 1000; i++) {
        feed(i, 0);
        TEST_ASSERT_FALSE(dahl_node_tick(&node, now_us, &out));
    }
    now_us += DAHL_NODE_TIMEOUT_US + 1;
    TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us, &out));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_GOOD, dahl_frames_unpack_status(&out, &status));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_STALE, status.state);
    TEST_ASSERT_FALSE(dahl_node_tick(&node, now_us + 1000000, &out));
    dahl_node_bus_off(&node, now_us);
    TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us, &out));
}

/* In tens of ms, rounded up, and the longest that 8 bits can say. */
static void test_status_shows_the_timeout(void)
{
    const uint32_t us[][2] = {{100000, 10}, {1000, 1}, {10000, 1}, {10001, 2}, {2540001, 255}, {2550000, 255}, {60000000, 255}};
    TEST_ASSERT_EQUAL(DAHL_NODE_TIMEOUT_US / DAHL_FRAMES_TIMEOUT_US, status_now().timeout);
    for (size_t i = 0; i < sizeof us / sizeof us[0]; i++) {
        node.timeout_us = us[i][0];
        TEST_ASSERT_EQUAL(us[i][1], status_now().timeout);
    }
}

/* A number that is no parameter's is answered as none. */
static bool params_of(uint8_t param, uint32_t value, uint8_t write, dahl_param_reply_t *reply)
{
    dahl_can_frame_t frame;
    dahl_can_frame_t out;
    dahl_param_write_t asked = {.value = value, .counter = 5, .param = param, .write = write};
    dahl_frames_pack_param_write(&frame, NUMBER, &asked);
    TEST_ASSERT_TRUE(dahl_node_receive(&node, &frame, now_us, &out));
    TEST_ASSERT_EQUAL_HEX32(DAHL_FRAMES_ID_PARAM_REPLY | NUMBER, out.id);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_GOOD, dahl_frames_unpack_param_reply(&out, reply));
    TEST_ASSERT_EQUAL(5, reply->counter);
    TEST_ASSERT_EQUAL(param <= DAHL_FRAMES_PARAM_LOAD ? param : DAHL_FRAMES_PARAM_NONE, reply->param);
    return reply->result == DAHL_FRAMES_PARAM_DONE;
}

static bool set_param(uint8_t param, uint32_t value)
{
    dahl_param_reply_t reply;
    bool done = params_of(param, value, DAHL_FRAMES_PARAM_WRITE, &reply);
    TEST_ASSERT_TRUE(!done || reply.value == value);
    return done;
}

static uint32_t param_now(uint8_t param)
{
    dahl_param_reply_t reply;
    TEST_ASSERT_TRUE(params_of(param, 0, DAHL_FRAMES_PARAM_READ, &reply));
    return reply.value;
}

static void reset(uint8_t what)
{
    dahl_can_frame_t frame;
    dahl_can_frame_t out;
    dahl_frames_pack_reset(&frame, NUMBER, &(dahl_node_reset_t){.what = what});
    TEST_ASSERT_TRUE(dahl_node_receive(&node, &frame, now_us, &out));
    TEST_ASSERT_EQUAL_HEX32(DAHL_FRAMES_ID_STATUS | NUMBER, out.id);
}

/* The gain begins anew where there was a ramp when silence began; one that is set meanwhile is for the next time. */
static void test_a_ramp_that_is_set_in_silence_is_for_the_next_one(void)
{
    feed(0, 0);
    feed(1, 1000000);
    dahl_node_bus_off(&node, now_us);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_RAMP, 100));
    now_us += DAHL_NODE_TIMEOUT_US;
    (void)feed(4, 0);
    (void)feed(5, 0);
    TEST_ASSERT_TRUE(feed(6, 0));
    TEST_ASSERT_EQUAL(1 << 30, answer.torque_q30);
    dahl_node_bus_off(&node, now_us);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_RAMP, 0));
    TEST_ASSERT_EQUAL(0, node.gain_now);
}

static void test_with_a_step_limit_longer_gaps_are_bridged(void)
{
    for (uint32_t step = 1; step <= DAHL_NODE_GAP_MAX_STEP; step++) {
        dahl_state_t reference = {0};
        setUp();
        node.max_step = 100;
        feed(0, 0);
        TEST_ASSERT_TRUE(feed(step, (int32_t)step * 100));
        TEST_ASSERT_EQUAL(step == 1 ? DAHL_FRAMES_OK : DAHL_FRAMES_LOST, answer.state);
        TEST_ASSERT_EQUAL(dahl_step_counts_q30(&plan, &reference, (int32_t)step * 100), answer.torque_q30);
        TEST_ASSERT_EQUAL(step - 1, node.counts.lost);
    }
    TEST_ASSERT_FALSE(feed(2 * DAHL_NODE_GAP_MAX_STEP + 1, 0));
    TEST_ASSERT_EQUAL(1, node.counts.wrong_sequence);
}

/* A good frame says again why the node waits, where a corrupt one has said something else. */
static void test_after_a_corrupt_frame_the_state_is_that_of_the_start(void)
{
    dahl_can_frame_t corrupt = encoder_frame(4, 0);
    corrupt.data[3] ^= 1;
    give(&corrupt);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_CRC, node.state);
    TEST_ASSERT_TRUE(feed(0, 0));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_INIT, answer.state);
    dahl_node_bus_off(&node, now_us);
    now_us += DAHL_NODE_TIMEOUT_US;
    give(&corrupt);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_CRC, node.state);
    TEST_ASSERT_FALSE(feed(1, 0));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_STALE, node.state);
}

static void test_gain_and_limit_scale_the_answer_and_not_the_bristle(void)
{
    dahl_state_t reference = {0};
    int32_t full = 0;
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_GAIN, DAHL_NODE_ONE / 2));
    feed(0, 0);
    for (uint32_t i = 1; i < 200; i++) {
        TEST_ASSERT_TRUE(feed(i, i < 100 ? (int32_t)i : 200 - (int32_t)i));
        full = dahl_step_counts_q30(&plan, &reference, i < 101 ? 1 : -1);
        TEST_ASSERT_EQUAL(full / 2, answer.torque_q30);
    }
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_GAIN, DAHL_NODE_ONE));
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_LIMIT, DAHL_NODE_ONE / 4));
    feed(200, 2000);
    TEST_ASSERT_EQUAL(1 << 28, answer.torque_q30);
    feed(201, -2000);
    TEST_ASSERT_EQUAL(-(1 << 28), answer.torque_q30);
}

/* After frames 70 ms apart, as after any above 65 ms, the gain has gone 65535/65536 of what 65.536 ms are worth: never more
 * than time allows, and no product passes 32 bits. */
static void test_the_ramp_over_long_waits_goes_no_further_than_over_65_ms(void)
{
    const uint32_t ramps_ms[] = {100, 1000, 60000};
    for (size_t i = 0; i < 3; i++) {
        uint32_t step = DAHL_NODE_ONE * (DAHL_NODE_ONE - 1) / (1000 * ramps_ms[i]);
        setUp();
        node.gain_now = 0;
        node.timeout_us = 60000000;
        node.ramp_us = 1000 * ramps_ms[i];
        feed(0, 0);
        feed(1, 1000000);
        uint32_t at = node.gain_now;
        for (uint32_t k = 2; k < 5; k++) {
            now_us += k == 4 ? 50000000 : 69000;
            feed(k, 1000000);
            at = at + step < DAHL_NODE_ONE ? at + step : DAHL_NODE_ONE;
            TEST_ASSERT_UINT32_WITHIN(k, at, node.gain_now); /* and what steps have left over */
            TEST_ASSERT_EQUAL(((int64_t)node.gain_now << 30) / DAHL_NODE_ONE, answer.torque_q30);
        }
    }
}

static void test_the_gain_ramps_down_and_stops_where_it_should(void)
{
    node.ramp_us = 100000;
    feed(0, 0);
    feed(1, 1000000);
    TEST_ASSERT_EQUAL(1 << 30, answer.torque_q30);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_GAIN, DAHL_NODE_ONE / 2));
    for (uint32_t i = 2; i < 80; i++) {
        uint32_t gone = (i - 1) * DAHL_NODE_ONE / 100; /* 1 ms of 100 */
        uint32_t gain = gone < DAHL_NODE_ONE / 2 ? DAHL_NODE_ONE - gone : DAHL_NODE_ONE / 2;
        feed(i, 1000000);
        TEST_ASSERT_INT32_WITHIN(GAIN_STEP_Q30, ((int64_t)gain << 30) / DAHL_NODE_ONE, answer.torque_q30);
    }
}

/* No time has passed for a starting point, whatever the ramp; and 65,536 us are as many as 65,535. */
static void test_the_ramp_of_a_starting_point_and_of_65536_us(void)
{
    const uint32_t ramps_us[] = {1, 1000, 100000};
    for (size_t i = 0; i < 3; i++) {
        setUp();
        node.ramp_us = ramps_us[i];
        reset(DAHL_FRAMES_RESET_RESTART);
        now_us += 50000;
        TEST_ASSERT_TRUE(feed(0, 0));
        TEST_ASSERT_EQUAL(0, node.gain_now);
        now_us += 65536 - 1000;
        TEST_ASSERT_TRUE(feed(1, 0));
        TEST_ASSERT_EQUAL(i < 2 ? DAHL_NODE_ONE : 65536u * 65535u / 100000u, node.gain_now);
    }
}

/* Frames every 0.1, 0.5, 0.9, 1 and 1.1 ms, each worth less than one step of the gain or hardly more. */
static void test_a_ramp_of_a_minute_takes_a_minute_however_often_it_is_asked(void)
{
    const uint32_t periods_us[] = {100, 500, 900, 1000, 1100};
    for (size_t i = 0; i < 5; i++) {
        setUp();
        node.ramp_us = 60000000;
        reset(DAHL_FRAMES_RESET_RESTART);
        uint32_t frames = 60000000 / periods_us[i];
        for (uint32_t k = 0; k <= frames / 2; k++) {
            now_us += periods_us[i] - 1000; /* feed() lets 1 ms pass */
            TEST_ASSERT_TRUE(feed(k, 0));
        }
        TEST_ASSERT_UINT32_WITHIN(2, DAHL_NODE_ONE / 2, node.gain_now);
    }
}

/* What a long ramp has left over is at most one step of a shorter one. */
static void test_a_ramp_made_shorter_goes_on_from_where_it_is(void)
{
    node.ramp_us = 60000000;
    reset(DAHL_FRAMES_RESET_RESTART);
    feed(0, 0);
    now_us -= 100;
    feed(1, 0);
    TEST_ASSERT_EQUAL(0, node.gain_now);
    node.ramp_us = 1000000;
    feed(2, 0);
    TEST_ASSERT_UINT32_WITHIN(1, 66, node.gain_now);
    for (uint32_t k = 3; k < 12; k++) {
        feed(k, 0);
    }
    TEST_ASSERT_UINT32_WITHIN(2, 10 * 66, node.gain_now + 5);
}

/* Each frame comes a little before the one before it, by a clock that is set back. */
static void test_a_clock_that_goes_back_lets_no_jump_pass_and_moves_no_ramp(void)
{
    node.max_step = 100;
    node.ramp_us = 1000000;
    reset(DAHL_FRAMES_RESET_RESTART);
    TEST_ASSERT_TRUE(feed(0, 0));
    now_us -= 1001;
    TEST_ASSERT_FALSE(feed(1, 1000000));
    TEST_ASSERT_EQUAL(1, node.counts.jump);
    now_us -= 1001;
    TEST_ASSERT_TRUE(feed(2, 100));
    TEST_ASSERT_EQUAL(0, node.gain_now);
}

static void test_after_a_restart_the_ramp_begins_anew(void)
{
    feed(0, 0);
    feed(1, 1000000);
    TEST_ASSERT_EQUAL(1 << 30, answer.torque_q30);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_RAMP, 100));
    reset(DAHL_FRAMES_RESET_RESTART);
    TEST_ASSERT_TRUE(feed(2, 0));
    TEST_ASSERT_TRUE(feed(3, 1000000));
    TEST_ASSERT_EQUAL(655 << 14, answer.torque_q30);
}

static void test_parameters_are_checked_acknowledged_and_used(void)
{
    dahl_params_t other = params;
    dahl_plan_t want;
    dahl_state_t reference = {0};
    other.sigma0 = 75.0f;
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_prepare(&want, &other));
    feed(0, 0);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_SIGMA0, 75u << 10));
    feed(1, 500);
    TEST_ASSERT_EQUAL(dahl_step_counts_q30(&want, &reference, 500), answer.torque_q30);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_FC, 3u << 19));
    TEST_ASSERT_EQUAL_FLOAT(1.5f, node.params.Fc);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_THETA, 1u << 20));
    TEST_ASSERT_EQUAL_FLOAT(0x1p-18f, node.params.theta_per_count);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_TIMEOUT, 60000));
    TEST_ASSERT_EQUAL(60000000, node.timeout_us);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_STATUS, 0));
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_STEP, INT32_MAX));
}

/* A float has no halves from 2^23 on: rounding must not add one there. */
static void test_parameters_read_back_as_written_up_to_24_bits(void)
{
    for (uint32_t value = (1u << 24) - 9; value <= 1u << 24; value++) {
        TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_SIGMA0, value) && param_now(DAHL_FRAMES_PARAM_SIGMA0) == value);
    }
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_SIGMA0, (1u << 23) + 1) && param_now(DAHL_FRAMES_PARAM_SIGMA0) == (1u << 23) + 1);
    node.params.sigma0 = 0x1.7ffffep-11f; /* just below three quarters of a step */
    TEST_ASSERT_EQUAL(1, param_now(DAHL_FRAMES_PARAM_SIGMA0));
    node.params.sigma0 = 0x1.fffffep-12f; /* and just below half of one */
    TEST_ASSERT_EQUAL(0, param_now(DAHL_FRAMES_PARAM_SIGMA0));
}

/* What a raw value cannot say is the nearest that it can: a half goes up, what is too large is the largest. */
static void test_parameters_between_and_beyond_raw_values(void)
{
    const dahl_params_t fine = {.sigma0 = 3.5f * 0x1p-10f, .Fc = 2.25f * 0x1p-20f, .theta_per_count = 1e-4f};
    const dahl_params_t large = {.sigma0 = 1e10f, .Fc = 1e10f, .theta_per_count = 1.0f};
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_init(&node, &fine, NUMBER));
    TEST_ASSERT_EQUAL(4, param_now(DAHL_FRAMES_PARAM_SIGMA0));
    TEST_ASSERT_EQUAL(2, param_now(DAHL_FRAMES_PARAM_FC));
    TEST_ASSERT_EQUAL(2, node.counts.params);
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_init(&node, &large, NUMBER));
    TEST_ASSERT_EQUAL_HEX32(UINT32_MAX, param_now(DAHL_FRAMES_PARAM_SIGMA0));
    TEST_ASSERT_EQUAL_HEX32(UINT32_MAX, param_now(DAHL_FRAMES_PARAM_THETA));
}

/* Least and most of each, as the node then has them, in its own units. */
static void test_parameters_at_the_ends_of_their_range(void)
{
    const struct {
        uint8_t param;
        uint32_t least, most, unit;
        const uint32_t *held;
    } ends[] = {{DAHL_FRAMES_PARAM_GAIN, 0, DAHL_NODE_ONE, 1, &node.gain},          {DAHL_FRAMES_PARAM_LIMIT, 0, DAHL_NODE_ONE, 1, &node.limit},
                {DAHL_FRAMES_PARAM_RAMP, 0, 60000, 1000, &node.ramp_us},       {DAHL_FRAMES_PARAM_TIMEOUT, 1, 60000, 1000, &node.timeout_us},
                {DAHL_FRAMES_PARAM_STEP, 0, INT32_MAX, 1, &node.max_step},     {DAHL_FRAMES_PARAM_STATUS, 0, 60000, 1000, &node.status_us}};
    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        TEST_ASSERT_TRUE(set_param(ends[i].param, ends[i].most));
        TEST_ASSERT_EQUAL(ends[i].most * ends[i].unit, *ends[i].held);
        TEST_ASSERT_TRUE(set_param(ends[i].param, ends[i].least));
        TEST_ASSERT_EQUAL(ends[i].least * ends[i].unit, *ends[i].held);
        TEST_ASSERT_TRUE(set_param(ends[i].param, 5));
        TEST_ASSERT_EQUAL(5 * ends[i].unit, *ends[i].held);
    }
}

static void test_parameters_out_of_range_change_nothing(void)
{
    const struct {
        uint8_t param;
        uint32_t value;
    } bad[] = {{DAHL_FRAMES_PARAM_SIGMA0, 0},          {DAHL_FRAMES_PARAM_FC, 0},         {DAHL_FRAMES_PARAM_THETA, 0},
               {DAHL_FRAMES_PARAM_GAIN, DAHL_NODE_ONE + 1}, {DAHL_FRAMES_PARAM_LIMIT, 65537},  {DAHL_FRAMES_PARAM_RAMP, 60001},
               {DAHL_FRAMES_PARAM_TIMEOUT, 0},         {DAHL_FRAMES_PARAM_TIMEOUT, 60001}, {DAHL_FRAMES_PARAM_STEP, 0x80000000u},
               {DAHL_FRAMES_PARAM_STATUS, 60001}};
    dahl_param_reply_t reply;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        uint32_t before = param_now(bad[i].param);
        TEST_ASSERT_FALSE(params_of(bad[i].param, bad[i].value, DAHL_FRAMES_PARAM_WRITE, &reply));
        TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_OUT_OF_RANGE, reply.result);
        TEST_ASSERT_EQUAL(before, reply.value);
        TEST_ASSERT_EQUAL(before, param_now(bad[i].param));
    }
    params_of(DAHL_FRAMES_PARAM_LOAD + 1, 1, DAHL_FRAMES_PARAM_WRITE, &reply);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_UNKNOWN, reply.result);
    params_of(255, 1, DAHL_FRAMES_PARAM_READ, &reply);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_UNKNOWN, reply.result);
    TEST_ASSERT_EQUAL(50u << 10, param_now(DAHL_FRAMES_PARAM_SIGMA0));
    TEST_ASSERT_EQUAL(1u << 19, param_now(DAHL_FRAMES_PARAM_FC));
}

/* Whatever was asked of it. */
static void test_an_unknown_parameter_is_answered_by_its_number(void)
{
    dahl_param_reply_t reply;
    for (uint32_t param = DAHL_FRAMES_PARAM_LOAD + 1; param < 256; param++) {
        TEST_ASSERT_FALSE(params_of((uint8_t)param, 77, param % 4, &reply));
        TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_UNKNOWN, reply.result);
        TEST_ASSERT_EQUAL(param, reply.value);
    }
}

/* Sigma0 and Fc that only together are in range with the theta that there is, and back. */
static void test_a_model_that_is_in_range_only_as_a_whole_is_written_as_a_whole(void)
{
    dahl_param_reply_t reply;
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_THETA, UINT32_MAX) && set_param(DAHL_FRAMES_PARAM_SIGMA0, UINT32_MAX));
    TEST_ASSERT_FALSE(set_param(DAHL_FRAMES_PARAM_FC, 1));
    TEST_ASSERT_TRUE(params_of(DAHL_FRAMES_PARAM_SIGMA0, 1, DAHL_FRAMES_PARAM_HOLD, &reply));
    TEST_ASSERT_EQUAL(UINT32_MAX, reply.value); /* which still holds */
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_FC, 1));
    TEST_ASSERT_EQUAL_FLOAT(0x1p-10f, node.params.sigma0);
    TEST_ASSERT_EQUAL_FLOAT(0x1p-20f, node.params.Fc);
}

/* The torque never hears a half of it: a bristle at its end stays where twice the Fc and sigma0 have it. */
static void test_what_is_held_changes_nothing_until_the_last_is_written(void)
{
    dahl_param_reply_t reply;
    dahl_params_t both = {params.sigma0 * 2, params.Fc * 2, params.theta_per_count};
    dahl_state_t reference;
    dahl_plan_t want;
    feed(0, 0);
    feed(1, 300);
    reference = node.bearing;
    TEST_ASSERT_TRUE(params_of(DAHL_FRAMES_PARAM_FC, 1u << 20, DAHL_FRAMES_PARAM_HOLD, &reply));
    TEST_ASSERT_TRUE(feed(2, 250));
    TEST_ASSERT_EQUAL(dahl_step_counts_q30(&plan, &reference, -50), answer.torque_q30);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_SIGMA0, 100u << 10));
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_prepare(&want, &both));
    dahl_change_plan(&plan, &want, &reference);
    TEST_ASSERT_TRUE(feed(3, 270));
    TEST_ASSERT_EQUAL(dahl_step_counts_q30(&want, &reference, 20), answer.torque_q30);
}

static void test_what_is_held_goes_with_a_refusal_and_a_restart(void)
{
    dahl_param_reply_t reply;
    TEST_ASSERT_TRUE(params_of(DAHL_FRAMES_PARAM_SIGMA0, UINT32_MAX, DAHL_FRAMES_PARAM_HOLD, &reply));
    TEST_ASSERT_TRUE(params_of(DAHL_FRAMES_PARAM_THETA, UINT32_MAX, DAHL_FRAMES_PARAM_HOLD, &reply));
    TEST_ASSERT_FALSE(set_param(DAHL_FRAMES_PARAM_FC, 1));
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_FC, 1u << 20));
    TEST_ASSERT_EQUAL(50u << 10, param_now(DAHL_FRAMES_PARAM_SIGMA0));
    TEST_ASSERT_TRUE(params_of(DAHL_FRAMES_PARAM_SIGMA0, 7u << 10, DAHL_FRAMES_PARAM_HOLD, &reply));
    TEST_ASSERT_FALSE(params_of(DAHL_FRAMES_PARAM_THETA, 0, DAHL_FRAMES_PARAM_HOLD, &reply));
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_FC, 1u << 19));
    TEST_ASSERT_EQUAL(50u << 10, param_now(DAHL_FRAMES_PARAM_SIGMA0));
    TEST_ASSERT_TRUE(params_of(DAHL_FRAMES_PARAM_SIGMA0, 7u << 10, DAHL_FRAMES_PARAM_HOLD, &reply));
    reset(DAHL_FRAMES_RESET_RESTART);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_FC, 1u << 20));
    TEST_ASSERT_EQUAL(50u << 10, param_now(DAHL_FRAMES_PARAM_SIGMA0));
}

/* A parameter that is used by itself is not held, and there is no fourth thing to ask for. */
static void test_only_the_model_is_held(void)
{
    dahl_param_reply_t reply;
    TEST_ASSERT_FALSE(params_of(DAHL_FRAMES_PARAM_GAIN, 5, DAHL_FRAMES_PARAM_HOLD, &reply));
    TEST_ASSERT_FALSE(params_of(DAHL_FRAMES_PARAM_GAIN, 5, 3, &reply));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_OUT_OF_RANGE, reply.result);
    TEST_ASSERT_FALSE(params_of(DAHL_FRAMES_PARAM_FC, 1u << 20, 3, &reply));
    TEST_ASSERT_EQUAL(DAHL_NODE_ONE, param_now(DAHL_FRAMES_PARAM_GAIN));
    TEST_ASSERT_EQUAL(1u << 19, param_now(DAHL_FRAMES_PARAM_FC));
}

/* Some of everything that can go wrong. */
static void spoil(void)
{
    dahl_can_frame_t corrupt = encoder_frame(5, 0);
    dahl_can_frame_t off = {.id = DAHL_CAN_ERROR_BUS_OFF, .flags = DAHL_CAN_FRAME_ERROR, .length = 8}, out;
    corrupt.data[3] ^= 1;
    dahl_node_tick(&node, now_us, &out);
    feed(0, 0);
    feed(2, 5000);
    feed(2, 5000);
    give(&corrupt);
    give(&off);
    now_us += DAHL_NODE_TIMEOUT_US;
    feed(9, 6000);
    feed(10, 6000);
}

/* What a node says by itself and to each frame of a fixed story, as bytes. */
static size_t story(dahl_can_frame_t said[40])
{
    size_t count = 0;
    for (uint32_t i = 0; i < 20; i++) {
        dahl_can_frame_t frame = encoder_frame(i % 7 == 3 ? 0 : i, (int32_t)(i * i));
        now_us += 1000;
        count += dahl_node_tick(&node, now_us, &said[count]) ? 1u : 0u;
        count += dahl_node_receive(&node, &frame, now_us, &said[count]) ? 1u : 0u;
    }
    return count;
}

static void test_after_a_restart_a_node_says_what_one_after_power_on_says(void)
{
    dahl_can_frame_t fresh[40], again[40];
    dahl_can_frame_t frame, out;
    node.gain = 1000;
    node.ramp_us = 5000;
    node.gain_now = 0;
    uint32_t began_us = now_us;
    TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us, &out)); /* after power-on; the restart is answered by the same */
    size_t count = story(fresh);
    setUp();
    set_param(DAHL_FRAMES_PARAM_GAIN, 1000);
    set_param(DAHL_FRAMES_PARAM_RAMP, 5);
    spoil();
    now_us = began_us;
    dahl_frames_pack_reset(&frame, NUMBER, &(dahl_node_reset_t){.what = DAHL_FRAMES_RESET_RESTART});
    dahl_can_frame_t first = out;
    TEST_ASSERT_TRUE(dahl_node_receive(&node, &frame, now_us, &out));
    TEST_ASSERT_EQUAL_MEMORY(&first, &out, sizeof out);
    TEST_ASSERT_EQUAL(count, story(again));
    TEST_ASSERT_EQUAL_MEMORY(fresh, again, count * sizeof fresh[0]);
}

/* What Status shows begins anew with a Reset; what the node has counted since power-on is not a client's to wipe. */
static void test_errors_are_sticky_until_they_are_reset(void)
{
    spoil();
    dahl_node_counts_t before = node.counts;
    TEST_ASSERT_EQUAL_HEX8(1u << DAHL_FRAMES_REPEATED | 1u << DAHL_FRAMES_LOST | 1u << DAHL_FRAMES_CRC | 1u << DAHL_FRAMES_STALE, node.errors);
    reset(DAHL_FRAMES_RESET_ERRORS);
    dahl_node_status_t status = status_now();
    TEST_ASSERT_EQUAL_HEX8(0, status.errors);
    TEST_ASSERT_EQUAL(0, status.lost + status.corrupt + status.out_of_step);
    before.resets++;
    TEST_ASSERT_EQUAL_MEMORY(&before, &node.counts, sizeof before);
    feed(11, 6000);
    feed(13, 6000);
    feed(13, 6000);
    feed(14, 6000);
    status = status_now();
    TEST_ASSERT_EQUAL_HEX8(1u << DAHL_FRAMES_REPEATED | 1u << DAHL_FRAMES_LOST, status.errors);
    TEST_ASSERT_EQUAL(1, status.lost);
    TEST_ASSERT_EQUAL(1, status.out_of_step);
}

/* Neither ParamWrite nor Reset with a wrong CRC or form does anything but count, and gets no answer. */
static void test_a_bad_param_write_or_reset_is_only_counted(void)
{
    dahl_can_frame_t frames[2];
    dahl_can_frame_t out;
    dahl_frames_pack_param_write(&frames[0], NUMBER, &(dahl_param_write_t){.value = 5, .param = DAHL_FRAMES_PARAM_GAIN, .write = DAHL_FRAMES_PARAM_WRITE});
    dahl_frames_pack_reset(&frames[1], NUMBER, &(dahl_node_reset_t){.what = DAHL_FRAMES_RESET_RESTART});
    feed(0, 0);
    feed(1, 300);
    int64_t bristle = node.bearing.w;
    for (uint32_t i = 0; i < 2; i++) {
        frames[i].data[7] ^= 0x20;
        TEST_ASSERT_FALSE(dahl_node_receive(&node, &frames[i], now_us, &out));
        TEST_ASSERT_EQUAL(i + 1, node.counts.crc);
        frames[i].length = 6;
        TEST_ASSERT_FALSE(dahl_node_receive(&node, &frames[i], now_us, &out));
        TEST_ASSERT_EQUAL(i + 1, node.counts.format);
    }
    TEST_ASSERT_EQUAL_HEX8(1u << DAHL_FRAMES_CRC | DAHL_FRAMES_ERROR_FORMAT, node.errors);
    TEST_ASSERT_EQUAL(0, node.counts.params + node.counts.resets);
    TEST_ASSERT_EQUAL(DAHL_NODE_ONE, node.gain);
    TEST_ASSERT_EQUAL(bristle, node.bearing.w);
    TEST_ASSERT_TRUE(feed(2, 310));
}

/* What no version knows yet: answered by Status, as every Reset, and nothing is lost. */
static void test_a_reset_of_nothing_only_asks_for_status(void)
{
    feed(0, 0);
    feed(0, 0);
    feed(1, 300);
    int64_t bristle = node.bearing.w;
    for (uint8_t what = 0; what < 16; what++) {
        if (what != DAHL_FRAMES_RESET_ERRORS && what != DAHL_FRAMES_RESET_RESTART) {
            reset(what);
        }
    }
    TEST_ASSERT_EQUAL(14, node.counts.resets);
    TEST_ASSERT_EQUAL(1, node.counts.repeated);
    TEST_ASSERT_EQUAL_HEX8(1u << DAHL_FRAMES_REPEATED, node.errors);
    TEST_ASSERT_EQUAL(bristle, node.bearing.w);
    TEST_ASSERT_TRUE(feed(2, 310));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_OK, answer.state);
}

static void test_a_refused_model_leaves_the_node_alone(void)
{
    const dahl_params_t bad = {.sigma0 = -1.0f, .Fc = 0.5f, .theta_per_count = 1e-4f};
    dahl_node_t before = node;
    TEST_ASSERT_EQUAL(DAHL_ERR_PARAM, dahl_node_init(&node, &bad, NUMBER));
    TEST_ASSERT_EQUAL_MEMORY(&before, &node, sizeof node);
}

/* --- bus-off ------------------------------------------------------------------------------------------------------ */

/* True: the third good frame, sent now, is answered. */
static bool comes_back(void)
{
    bool early = feed(4, 500) || feed(5, 510);
    return feed(6, 520) && !early;
}

static void test_bus_off_is_told_at_once_and_over_after_the_timeout(void)
{
    dahl_can_frame_t out;
    feed(0, 0);
    feed(1, 300);
    int64_t bristle = node.bearing.w;
    dahl_node_tick(&node, now_us, &out);
    dahl_node_bus_off(&node, now_us);
    TEST_ASSERT_TRUE(dahl_node_tick(&node, now_us, &out)); /* Status, without waiting for its period */
    TEST_ASSERT_EQUAL_HEX8(1u << DAHL_FRAMES_STALE, node.errors);
    now_us += DAHL_NODE_TIMEOUT_US - 4000;
    TEST_ASSERT_FALSE(comes_back()); /* the last of the three 1 ms before the time */
    TEST_ASSERT_TRUE(comes_back());
    TEST_ASSERT_EQUAL(DAHL_FRAMES_STALE, answer.state);
    TEST_ASSERT_EQUAL(bristle, node.bearing.w);
    TEST_ASSERT_EQUAL(1, node.counts.bus_off);
    TEST_ASSERT_EQUAL(0, node.counts.stale);
    TEST_ASSERT_EQUAL(5, node.counts.rearm);
}

/* The wait grows with the timeout. A frame that it holds is none of the three in a row; found by the fuzzer. */
static void test_a_longer_timeout_holds_again_and_the_row_begins_anew(void)
{
    feed(0, 0);
    dahl_node_bus_off(&node, now_us);
    now_us += DAHL_NODE_TIMEOUT_US;
    TEST_ASSERT_FALSE(feed(4, 500) || feed(5, 510));
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_TIMEOUT, 60000));
    TEST_ASSERT_FALSE(feed(6, 520));
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_TIMEOUT, 100));
    TEST_ASSERT_FALSE(feed(6, 520) || feed(7, 530));
    TEST_ASSERT_TRUE(feed(8, 540));
}

static void test_the_fourth_bus_off_without_an_answer_is_latched_until_a_restart(void)
{
    for (uint32_t i = 0; i < 10; i++) { /* an answer in between forgives */
        dahl_node_bus_off(&node, now_us);
        now_us += DAHL_NODE_TIMEOUT_US;
        TEST_ASSERT_TRUE(comes_back());
    }
    for (uint32_t i = 0; i < DAHL_NODE_OFF_MAX - 1; i++) {
        dahl_node_bus_off(&node, now_us);
    }
    now_us += DAHL_NODE_TIMEOUT_US;
    TEST_ASSERT_TRUE(comes_back());
    for (uint32_t i = 0; i < DAHL_NODE_OFF_MAX; i++) {
        dahl_node_bus_off(&node, now_us);
    }
    now_us += 10 * DAHL_NODE_TIMEOUT_US;
    TEST_ASSERT_FALSE(comes_back());
    reset(DAHL_FRAMES_RESET_ERRORS);
    TEST_ASSERT_FALSE(comes_back());
    reset(DAHL_FRAMES_RESET_RESTART);
    TEST_ASSERT_TRUE(feed(7, 530));
}

/* A restart forgives all of them: as many may follow as after power-on, with no answer in between. */
static void test_after_a_restart_bus_offs_are_counted_anew(void)
{
    for (uint32_t i = 0; i < DAHL_NODE_OFF_MAX; i++) {
        dahl_node_bus_off(&node, now_us);
    }
    reset(DAHL_FRAMES_RESET_RESTART);
    for (uint32_t i = 0; i < DAHL_NODE_OFF_MAX - 1; i++) {
        dahl_node_bus_off(&node, now_us);
    }
    now_us += DAHL_NODE_TIMEOUT_US;
    TEST_ASSERT_TRUE(comes_back());
}

static void test_any_number_of_bus_offs_stays_latched(void)
{
    for (uint32_t i = 1; i <= 300; i++) {
        dahl_node_bus_off(&node, now_us);
        if (i >= DAHL_NODE_OFF_MAX) {
            now_us += DAHL_NODE_TIMEOUT_US;
            TEST_ASSERT_FALSE(comes_back());
        }
    }
    TEST_ASSERT_EQUAL(300, node.counts.bus_off);
}

/* --- the fault table, row by row ---------------------------------------------------------------------------------- */

#define SENT(counter, count) {FRAME, counter, count, 0, 0}
#define FLAGGED_AS(flag) {FLAGGED, 1, 70, 0, flag}
#define THIRD_OF_OTHERS SENT(0, 0), SENT(9, 60), SENT(10, 65), SENT(11, 70)
#define TIMES_OUT WAITS(DAHL_NODE_TIMEOUT_US + 1)
#define THREE_MORE SENT(1, 60), SENT(2, 65), SENT(3, 70)

/* Each brings the node to where a row begins; the row is about the last beat. */
static const beat_t play_FIRST[] = {SENT(7, 70)};
static const beat_t play_NEXT[] = {SENT(0, 0), SENT(1, 70)};
static const beat_t play_GAP[] = {SENT(0, 0), SENT(3, 70)};
static const beat_t play_LONG_GAP[] = {MAY_STEP(100), SENT(0, 0), SENT(8, 70)};
static const beat_t play_AGAIN[] = {SENT(0, 0), SENT(0, 70)};
static const beat_t play_OTHER[] = {SENT(0, 0), SENT(9, 70)};
static const beat_t play_FAR[] = {MAY_STEP(10), SENT(0, 0), SENT(1, 70000)};
static const beat_t play_THIRD[] = {THIRD_OF_OTHERS};
static const beat_t play_THIRD_FAR[] = {MAY_STEP(10), SENT(0, 0), SENT(1, 70000), SENT(2, 70005), SENT(3, 70010)};
static const beat_t play_THIRD_NEAR[] = {MAY_STEP(100), THIRD_OF_OTHERS};
static const beat_t play_DISOWNED[] = {SENT(0, 0), DISOWNS(1, 70)};
static const beat_t play_BAD_CRC[] = {SENT(0, 0), SPOILS(1)};
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
static const row_t rows[] = {FAULT_TABLE(ROW)};

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

/* Whatever comes, from random frames to nearly good ones, the state stays in range and each frame has one fate. */
static void test_random_input_breaks_nothing(void)
{
    uint64_t seed = 2;
    const uint32_t rounds = 200000;
    for (uint32_t i = 0; i < rounds; i++) {
        dahl_can_frame_t frame = encoder_frame(random_u32(&seed), (int32_t)random_u32(&seed));
        uint32_t chance = random_u32(&seed);
        frame.id = chance % 7 == 0 ? random_u32(&seed) : frame.id;
        frame.flags = chance % 11 == 0 ? (uint8_t)random_u32(&seed) : 0;
        frame.length = chance % 13 == 0 ? (uint8_t)(random_u32(&seed) % 9) : 8;
        frame.data[chance % 8] ^= chance % 3 == 0 ? (uint8_t)random_u32(&seed) : 0;
        give(&frame);
        dahl_state_t copy = node.bearing;
        TEST_ASSERT_INT_WITHIN(1 << 30, 0, dahl_step_counts_q30(&plan, &copy, 0));
    }
    const dahl_node_counts_t *n = &node.counts;
    TEST_ASSERT_EQUAL(rounds,
                      n->ok + n->repeated + n->wrong_sequence + n->crc + n->format + n->invalid + n->ignored + n->jump +
                          n->rearm + n->params + n->resets + n->bus_off);
}

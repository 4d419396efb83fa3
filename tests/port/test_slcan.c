/* SPDX-License-Identifier: MIT */
/* slcan, line by line: what it takes, what it refuses and under which name; any bytes. python-can's own lines come from
 * Python. */
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "random.h"
#include "slcan/slcan.h"

static struct {
    slcan_t adapter;
    uint8_t guard[8]; /* right behind the line */
} guarded;
#define adapter (guarded.adapter)
static dahl_can_frame_t frame;
static char text[SLCAN_TEXT_MAX];

void setUp(void)
{
    memset(&adapter, 0, sizeof adapter);
    memset(guarded.guard, 0xA5, sizeof guarded.guard);
    memset(&frame, 0xA5, sizeof frame);
}

void tearDown(void)
{
    TEST_ASSERT_EQUAL_PTR(guarded.guard, adapter.line + SLCAN_LINE_MAX);
    for (size_t i = 0; i < sizeof guarded.guard; i++) {
        TEST_ASSERT_EQUAL_HEX8(0xA5, guarded.guard[i]);
    }
}

/* All of a line; only its last byte, CR, has an event. */
static slcan_event_t feed_bytes(const char *line, size_t length)
{
    for (size_t i = 0; i < length; i++) {
        TEST_ASSERT_EQUAL(SLCAN_NOTHING, slcan_take(&adapter, (uint8_t)line[i], &frame, text));
    }
    return slcan_take(&adapter, '\r', &frame, text);
}

static slcan_event_t feed(const char *line)
{
    return feed_bytes(line, strlen(line));
}

static void expect_answer(const char *line, const char *wanted)
{
    TEST_ASSERT_EQUAL_MESSAGE(SLCAN_ANSWER, feed(line), line);
    TEST_ASSERT_EQUAL_STRING_MESSAGE(wanted, text, line);
}

static void expect_frame(const char *line, const dahl_can_frame_t *wanted)
{
    memset(&frame, 0xA5, sizeof frame);
    TEST_ASSERT_EQUAL_MESSAGE(SLCAN_FRAME, feed(line), line);
    TEST_ASSERT_EQUAL_STRING("\r", text);
    TEST_ASSERT_EQUAL_HEX32(wanted->id, frame.id);
    TEST_ASSERT_EQUAL(wanted->flags, frame.flags);
    TEST_ASSERT_EQUAL(wanted->length, frame.length);
    TEST_ASSERT_EQUAL_MEMORY(wanted->data, frame.data, 8);
    TEST_ASSERT_TRUE(frame.time_us == 0);
}

static const dahl_can_frame_t small = {.id = 0x100, .length = 2, .data = {0xAB, 0x12}};

static void test_each_kind_of_frame_is_taken_and_written(void)
{
    static const struct {
        const char *line;
        dahl_can_frame_t frame;
    } kinds[] = {
        {"t1002AB12", {.id = 0x100, .length = 2, .data = {0xAB, 0x12}}},
        {"t0000", {.id = 0}},
        {"t7FF80123456789ABCDEF", {.id = 0x7FF, .length = 8, .data = {1, 0x23, 0x45, 0x67, 0x89, 0xAB, 0xCD, 0xEF}}},
        {"T1ABCDEF0109", {.id = 0x1ABCDEF0, .flags = DAHL_CAN_FRAME_EXTENDED, .length = 1, .data = {9}}},
        {"T1FFFFFFF0", {.id = 0x1FFFFFFF, .flags = DAHL_CAN_FRAME_EXTENDED}},
        {"r7FF4", {.id = 0x7FF, .flags = DAHL_CAN_FRAME_REMOTE, .length = 4}},
        {"R000000018", {.id = 1, .flags = DAHL_CAN_FRAME_EXTENDED | DAHL_CAN_FRAME_REMOTE, .length = 8}},
    };
    TEST_ASSERT_EQUAL(SLCAN_ANSWER, feed("O"));
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        size_t length = strlen(kinds[i].line);
        expect_frame(kinds[i].line, &kinds[i].frame);
        TEST_ASSERT_EQUAL(length + 1, slcan_write(&kinds[i].frame, text));
        TEST_ASSERT_EQUAL_STRING_LEN(kinds[i].line, text, length);
        TEST_ASSERT_EQUAL_STRING("\r", text + length);
    }
}

/* A frame of CAN FD is seen as one, whatever its length; no line says it back. */
static void test_frames_of_can_fd_are_taken_with_their_first_8_bytes(void)
{
    static const uint8_t lengths[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    char line[SLCAN_LINE_MAX + 1];
    TEST_ASSERT_EQUAL(SLCAN_ANSWER, feed("O"));
    for (uint32_t i = 0; i < 64; i++) {
        bool extended = i % 2 != 0;
        uint8_t code = (uint8_t)(i / 4), kept = code <= 8 ? code : 8;
        dahl_can_frame_t wanted = {.id = 0x123, .flags = DAHL_CAN_FRAME_FD, .length = kept};
        wanted.flags |= extended ? DAHL_CAN_FRAME_EXTENDED : 0;
        int at = sprintf(line, extended ? "%c%08X%X" : "%c%03X%X", "dDbB"[i % 4], 0x123u, (unsigned)code);
        for (uint32_t byte = 0; byte < lengths[code]; byte++) {
            at += sprintf(line + at, "%02X", (unsigned)byte + 1);
            wanted.data[byte < 8 ? byte : 7] = (uint8_t)(byte < 8 ? byte + 1 : 8);
        }
        expect_frame(line, &wanted);
        TEST_ASSERT_EQUAL(0, slcan_write(&wanted, text));
    }
}

static void test_digits_are_large_or_small_and_line_feeds_nothing(void)
{
    const dahl_can_frame_t all = {.id = 0x1ABCDEF9, .flags = DAHL_CAN_FRAME_EXTENDED, .length = 2, .data = {0xAF, 0x09}};
    feed("L");
    expect_frame("T1abcdef92aF09", &all);
    expect_frame("T1AbCdEf92Af09", &all);
    expect_frame("\nt10\n02AB12\n", &small);
}

#define X10 "xxxxxxxxxx"
#define X137 X10 X10 X10 X10 X10 X10 X10 X10 X10 X10 X10 X10 X10 "xxxxxxx"

#define REFUSED(line, why) {line, sizeof(line) - 1, offsetof(slcan_counts_t, why)}

/* Lines, and the count that each adds to: the first thing that is wrong is what counts. */
static const struct {
    const char *line;
    size_t length;
    size_t count;
} refused[] = {
    /* ended too early or too late */
    REFUSED("t", cut), REFUSED("t10", cut), REFUSED("t100", cut), REFUSED("t1002AB", cut), REFUSED("t1002AB1", cut),
    REFUSED("T1ABCDEF", cut), REFUSED("T1ABCDEF0", cut), REFUSED("r123", cut),
    REFUSED("d1009000102030405060708090A", cut), REFUSED("b1002AB1234", wrong_length),
    REFUSED("t10080000000000000000000000", wrong_length), REFUSED("T1ABCDEF080123456789ABCDEF0", wrong_length),
    REFUSED(X137 "xx", too_long), REFUSED(X137 "x", unknown), /* as long as a line can be */
    /* characters that are no digits */
    REFUSED("d100zAB", not_hex), REFUSED("t1x02AB12", not_hex), REFUSED("t100gAB12", not_hex), REFUSED("t100GAB12", not_hex),
    REFUSED("t1002AB1/", not_hex), REFUSED("t1002AB:2", not_hex), REFUSED("t1002AB@2", not_hex), REFUSED("t1002AB`2", not_hex),
    REFUSED("t1002AB\0002", not_hex), REFUSED("t1002AB\3772", not_hex), REFUSED("t100GAB1", not_hex),
    REFUSED("tgggggggggggg", not_hex), REFUSED("t1002g", not_hex),
    /* lengths and ids out of range */
    REFUSED("t10090000000000000000", wrong_length), REFUSED("t100F", wrong_length), REFUSED("r1009", wrong_length),
    REFUSED("t1002AB1234", wrong_length), REFUSED("t1000AB", wrong_length), REFUSED("t10000", wrong_length),
    REFUSED("r1002AB12", wrong_length), REFUSED("t8002AB12", wrong_length), REFUSED("T200000002AB12", wrong_length),
    REFUSED("TFFFFFFFF0", wrong_length),
    /* commands */
    REFUSED("q", unknown), REFUSED("OO", unknown), REFUSED("CC", unknown), REFUSED("\000", unknown), REFUSED("Z1", unknown),
    REFUSED("V1", unknown), REFUSED("o", unknown),
};

/* Refused by one count, with BEL; the frame before it stays as it was, and the next line is read. */
static void test_lines_that_are_refused(void)
{
    for (size_t i = 0; i < sizeof refused / sizeof refused[0]; i++) {
        const char *line = refused[i].line;
        tearDown();
        setUp();
        feed("O");
        dahl_can_frame_t before = frame;
        slcan_counts_t wanted = {0};
        *(uint32_t *)(void *)((char *)&wanted + refused[i].count) = 1;
        TEST_ASSERT_EQUAL_MESSAGE(SLCAN_ANSWER, feed_bytes(line, refused[i].length), line);
        TEST_ASSERT_EQUAL_STRING_MESSAGE("\a", text, line);
        TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&wanted, &adapter.counts, sizeof wanted, line);
        TEST_ASSERT_EQUAL_MEMORY(&before, &frame, sizeof frame);
        expect_frame("t1002AB12", &small);
        expect_answer("F", "F80\r");
        expect_answer("F", "F00\r");
    }
}

/* Every line gets exactly one answer, every refusal is counted once, and the next good frame comes through. */
static void test_any_bytes(void)
{
    static const char alphabet[] = "tTrRdDbBOCLVvNFSs0123456789ABCDEFabcdefgG\n\r\r\r";
    uint64_t seed = 5;
    for (uint32_t run = 0; run < 20000; run++) {
        uint32_t lines = 1, refusals = 0, answers = 0, length = random_u32(&seed) % 300;
        memset(&adapter, 0, sizeof adapter);
        for (uint32_t i = 0; i <= length; i++) {
            bool any = random_u32(&seed) % 8 == 0;
            uint8_t byte = any ? (uint8_t)random_u32(&seed) : (uint8_t)alphabet[random_u32(&seed) % (sizeof alphabet - 1)];
            byte = i == length ? '\r' : byte;
            lines += byte == '\r' && i < length;
            slcan_event_t event = slcan_take(&adapter, byte, &frame, text);
            answers += event != SLCAN_NOTHING;
            refusals += event == SLCAN_ANSWER && strcmp(text, "\a") == 0;
        }
        const slcan_counts_t *n = &adapter.counts;
        TEST_ASSERT_EQUAL(lines, answers);
        TEST_ASSERT_EQUAL(refusals, n->too_long + n->cut + n->not_hex + n->wrong_length + n->unknown + n->closed);
        expect_answer("O", "\r");
        expect_frame("t1002AB12", &small);
    }
}

static void test_commands_have_their_answers(void)
{
    expect_answer("", "\r");
    expect_answer("V", "V0101\r");
    expect_answer("v", "v0101\r");
    expect_answer("N", "NDAHL\r");
    expect_answer("S8", "\r");
    expect_answer("s031C", "\r");
    expect_answer("F", "F00\r");
    TEST_ASSERT_FALSE(adapter.open);
}

static void test_closed_it_takes_no_frame(void)
{
    expect_answer("t1002AB12", "\a");
    TEST_ASSERT_EQUAL(1, adapter.counts.closed);
    expect_answer("t1x02AB12", "\a"); /* wrong by itself */
    TEST_ASSERT_EQUAL(1, adapter.counts.not_hex);
    TEST_ASSERT_EQUAL(1, adapter.counts.closed);
    expect_answer("O", "\r");
    expect_frame("t1002AB12", &small);
    expect_answer("C", "\r");
    expect_answer("t1002AB12", "\a");
    TEST_ASSERT_EQUAL(2, adapter.counts.closed);
    expect_answer("L", "\r");
    expect_frame("t1002AB12", &small);
}

static void test_frames_that_no_line_can_carry(void)
{
    const dahl_can_frame_t bad[] = {
        {.id = 1, .flags = DAHL_CAN_FRAME_FD}, {.id = 1, .flags = DAHL_CAN_FRAME_ERROR}, {.id = 1, .length = 9}};
    strcpy(text, "same");
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        TEST_ASSERT_EQUAL(0, slcan_write(&bad[i], text));
        TEST_ASSERT_EQUAL_STRING("same", text);
    }
}

/* SPDX-License-Identifier: MIT */
/* slcan: the laws of its fuzzer, which reads each line a second time, on random lines; and the count that each refused line
 * increases. tests/python/can/test_slcan.py exchanges frames with python-can. */
#include <unity.h>

#define LAW(condition, words) TEST_ASSERT_TRUE_MESSAGE(condition, words)
#include "../fuzz/slcan.c"
#include "random.h"

static uint64_t seed;

void setUp(void)
{
    seed = 5;
}

static uint32_t below(uint32_t n)
{
    return random_u32(&seed) % n;
}

static size_t random_digits(char *text, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        text[i] = "0123456789ABCDEFabcdef"[below(22)];
    }
    return count;
}

/* A line that is good more often than not: the id may be too large, the data cut, one character wrong. */
static size_t random_line(char *line)
{
    static const uint8_t bytes[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    const uint32_t kind = below(10), code = below(4) == 0 ? below(16) : below(9);
    size_t length = 1;
    line[0] = "tTrRdDbBFO"[kind];
    if (kind < 8) {
        length += random_digits(line + 1, kind % 2 ? 8 : 3);
        line[1] = below(8) == 0 ? line[1] : "01"[below(2)];
        line[length++] = "0123456789ABCDEF"[code];
        length += random_digits(line + length, kind == 2 || kind == 3 ? 0 : 2 * bytes[code]);
    }
    if (below(4) == 0) {
        line[below((uint32_t)length)] = "/:@GZg`\n \xff"[below(10)];
    }
    length -= below(8) == 0 ? 1 : 0;
    length += below(8) == 0 ? random_digits(line + length, 1 + below(2)) : 0;
    line[length++] = '\r';
    return length;
}

static void test_random_lines_have_the_answer_count_and_frame_of_a_second_reader(void)
{
    char bytes[20 * 150];
    for (uint32_t run = 0; run < 5000; run++) {
        size_t length = 0;
        memcpy(bytes, "O\r", 2);
        for (length = run % 8 == 0 ? 0 : 2; length < sizeof bytes - 150;) {
            length += random_line(bytes + length);
        }
        (void)LLVMFuzzerTestOneInput((const uint8_t *)bytes, length);
    }
    fuzz_at_random(20000, 300);
}

static void test_commands_have_the_answers_of_a_second_reader(void)
{
    static const char session[] = "t1002AB12\rt1x02AB12\r\rV\rv\rN\rS8\rs031C\rF\rO\rt1002AB12\rC\rt1002AB12\rL\r\nt10\n02AB12\nL\rF\rF\rq\rF\rF\r"
                                  "T1FFFFFFF0\rT200000000\rt7FF0\rt8000\rR000000018\rr7FF9\r";
    (void)LLVMFuzzerTestOneInput((const uint8_t *)session, sizeof session - 1);
}

#define X10 "xxxxxxxxxx"
#define X137 X10 X10 X10 X10 X10 X10 X10 X10 X10 X10 X10 X10 X10 "xxxxxxx"

#define REFUSED(line, why) {line, sizeof(line) - 1, offsetof(slcan_counts_t, why)}

/* Lines, and the count that each increases: that of the first fault in the line. */
static const struct {
    const char *line;
    size_t length;
    size_t count;
} refused[] = {
    REFUSED("t", cut), REFUSED("t1002AB1", cut), REFUSED("d1009000102030405060708090A", cut),
    REFUSED("t1000AB", wrong_length), REFUSED("r1002AB12", wrong_length), REFUSED("r1009", wrong_length), REFUSED("t8002AB12", wrong_length),
    REFUSED("T200000002AB12", wrong_length), REFUSED("b1002AB1234", wrong_length),
    REFUSED(X137 "xx", too_long), REFUSED(X137 "x", unknown), /* the longest line */
    REFUSED("t1x02AB12", not_hex), REFUSED("t1002AB1/", not_hex), REFUSED("t1002AB\0002", not_hex), REFUSED("t1002AB\3772", not_hex),
    REFUSED("tgggggggggggg", not_hex), REFUSED("t1x02AB1", not_hex), /* and then a wrong length */
    REFUSED("q", unknown), REFUSED("OO", unknown), REFUSED("\000", unknown), REFUSED("o", unknown),
};

static void test_each_refused_line_increases_one_count_and_writes_no_frame(void)
{
    static struct {
        slcan_t adapter;
        uint8_t guard[8]; /* directly behind the line */
    } guarded;
    for (size_t i = 0; i < sizeof refused / sizeof refused[0]; i++) {
        slcan_counts_t wanted = {0};
        dahl_can_frame_t frame, before;
        char text[SLCAN_TEXT_MAX];
        memset(&guarded, 0, sizeof guarded);
        memset(&frame, 0xA5, sizeof frame);
        before = frame;
        guarded.adapter.open = true;
        *(uint32_t *)(void *)((char *)&wanted + refused[i].count) = 1;
        for (size_t k = 0; k < refused[i].length; k++) {
            TEST_ASSERT_EQUAL(SLCAN_NOTHING, slcan_take(&guarded.adapter, (uint8_t)refused[i].line[k], &frame, text));
        }
        TEST_ASSERT_EQUAL_MESSAGE(SLCAN_ANSWER, slcan_take(&guarded.adapter, '\r', &frame, text), refused[i].line);
        TEST_ASSERT_EQUAL_STRING_MESSAGE("\a", text, refused[i].line);
        TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&wanted, &guarded.adapter.counts, sizeof wanted, refused[i].line);
        TEST_ASSERT_EQUAL_MEMORY(&before, &frame, sizeof frame);
        TEST_ASSERT_EACH_EQUAL_HEX8(0, guarded.guard, sizeof guarded.guard);
    }
}

static void test_frames_without_a_line_are_not_written(void)
{
    const dahl_can_frame_t bad[] = {
        {.id = 1, .flags = DAHL_CAN_FRAME_FD}, {.id = 1, .flags = DAHL_CAN_FRAME_ERROR}, {.id = 1, .length = 9}};
    char text[SLCAN_TEXT_MAX] = "same";
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        TEST_ASSERT_EQUAL(0, slcan_write(&bad[i], text));
        TEST_ASSERT_EQUAL_STRING("same", text);
    }
}

/* SPDX-License-Identifier: MIT */
/* slcan: the properties of its fuzzer, which reads each line a second time, on random lines. */
#include <unity.h>

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
    if (below(16) == 0) { /* a bit rate */
        line[0] = "Ss"[below(2)];
        size_t digits = random_digits(line + 1, below(below(4) ? 3 : 140));
        line[1 + digits] = "\r/:g"[below(8) < 5 ? 0 : below(4)];
        line[2 + digits] = '\r';
        return digits + (line[1 + digits] == '\r' ? 2 : 3);
    }
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
    static const char session[] = "t1002AB12\rt1x02AB12\r\rV\rv\rN\rS8\rS9\rs031C\rF\rO\rt1002AB12\rC\rt1002AB12\rL\r\nt10\n02AB12\nL\rF\rF\rq\rF\rF\r"
                                  "T1FFFFFFF0\rT200000000\rt7FF0\rt8000\rR000000018\rr7FF9\rOO\ro\r\0\rt\rr1002AB12\r"
                                  "t1002AB\0002\rt1002AB\3772\rt1x02AB1\rtggggg\r";
    (void)LLVMFuzzerTestOneInput((const uint8_t *)session, sizeof session - 1);
}

static void test_a_line_that_is_no_bit_rate_is_refused(void)
{
    static const char *const good[] = {"S0\r", "S9\r", "s0\r", "s031C\r", "sfF\r", "s01234567\r"};
    static const char *const bad[] = {"S\r", "S/\r", "S:\r", "SA\r", "S10\r", "S 1\r", "s\r", "s03G\r", "s 1\r", "s012345678\r"};
    char text[SLCAN_TEXT_MAX];
    for (size_t i = 0; i < sizeof good / sizeof good[0] + sizeof bad / sizeof bad[0]; i++) {
        const bool is_good = i < sizeof good / sizeof good[0];
        const char *line = is_good ? good[i] : bad[i - sizeof good / sizeof good[0]];
        slcan_t adapter = {.length = 0};
        for (const char *c = line; *c != '\0'; c++) {
            (void)slcan_take(&adapter, (uint8_t)*c, &(dahl_can_frame_t){.id = 0}, text);
        }
        TEST_ASSERT_EQUAL_STRING_MESSAGE(is_good ? "\r" : "\a", text, line);
        TEST_ASSERT_EQUAL(is_good ? 0 : 1, adapter.counts.unknown + adapter.counts.not_hex);
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

/* SPDX-License-Identifier: MIT */
/* Loopback, the bus over a serial port, the text of the socketcand protocol, and its client beside a server that
 * misbehaves. All else of the sockets is tested from Python, by python-can. */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#include <unity.h>

#include "dahl_frames.h"
#include "frame_bits.h"
#include "loopback/loopback.h"
#include "random.h"
#include "slcan/serial_bus.h"
#include "socketcand/client.h"
#include "socketcand/outbox.h"
#include "socketcand/text.h"
#include "timed_loopback/timed_loopback.h"

static uint64_t clock_ns;
static uint32_t waited_us;

static uint64_t now(void *context)
{
    (void)context;
    return clock_ns;
}

static void wait_us(void *context, uint32_t us)
{
    (void)context;
    waited_us += us;
}

static loopback_t loopback;

void setUp(void)
{
    clock_ns = 5000;
    waited_us = 0;
    loopback_open(&loopback, (dahl_can_clock_t){.now_ns = now, .wait_us = wait_us});
}

void tearDown(void)
{
}

static void test_loopback_gives_back_in_order_with_its_own_time(void)
{
    dahl_can_frame_t in = {.length = 8};
    dahl_can_frame_t out;
    for (uint32_t i = 0; i < 100; i++) {
        clock_ns = i * 1000000u;
        in.id = i;
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&loopback.bus, &in));
    }
    for (uint32_t i = 0; i < 100; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&loopback.bus, &out, 0));
        TEST_ASSERT_EQUAL(i, out.id);
        TEST_ASSERT_EQUAL(i * 1000u, out.time_us);
        TEST_ASSERT_EQUAL(DAHL_CAN_FRAME_OWN, out.flags);
    }
}

static void test_an_empty_loopback_waits_by_the_clock(void)
{
    dahl_can_frame_t out;
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 0));
    TEST_ASSERT_EQUAL(0, waited_us);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 700));
    TEST_ASSERT_EQUAL(700, waited_us);
}

/* A clock without a wait, as a firmware's: then there is none. Nobody else is there, and closing keeps what was sent. */
static void test_a_loopback_without_a_wait_and_without_others(void)
{
    dahl_can_frame_t in = {.id = 5, .length = 1, .data = {9}};
    dahl_can_frame_t out;
    loopback_open(&loopback, (dahl_can_clock_t){.now_ns = now});
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 700));
    TEST_ASSERT_EQUAL(0, waited_us);
    TEST_ASSERT_EQUAL(0, loopback.bus.ops->peers(&loopback.bus));
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&loopback.bus, &in));
    loopback.bus.ops->close(&loopback.bus);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&loopback.bus, &out, 0));
    TEST_ASSERT_EQUAL(5, out.id);
    TEST_ASSERT_EQUAL(9, out.data[0]);
    loopback_open(&loopback, loopback.bus.clock);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 0));
}

/* The ring goes on where its free-running numbers wrap. */
static void test_a_queue_goes_on_where_its_numbers_wrap(void)
{
    dahl_can_frame_t in = {.length = 8};
    dahl_can_frame_t out;
    loopback.queue.head = loopback.queue.tail = UINT32_MAX - 3;
    for (uint32_t i = 0; i < FRAME_QUEUE_SIZE; i++) {
        in.id = i;
        TEST_ASSERT_EQUAL(FRAME_QUEUE_SIZE - i, frame_queue_room(&loopback.queue));
        TEST_ASSERT_TRUE(frame_queue_put(&loopback.queue, &in));
    }
    TEST_ASSERT_FALSE(frame_queue_put(&loopback.queue, &in));
    for (uint32_t i = 0; i < FRAME_QUEUE_SIZE; i++) {
        TEST_ASSERT_TRUE(frame_queue_take(&loopback.queue, &out));
        TEST_ASSERT_EQUAL(i, out.id);
    }
    TEST_ASSERT_FALSE(frame_queue_take(&loopback.queue, &out));
}

static void wait_on(void *context, uint32_t us)
{
    (void)context;
    clock_ns += us * UINT64_C(1000);
}

/* All ask at once: by the standard's arbitration, where an id of 11 bits wins over one of 29 that begins with it. */
static void test_the_highest_priority_goes_first(void)
{
    static timed_loopback_t timed;
    static const dahl_can_frame_t frames[] = {
        {.id = 0x101}, {.id = 0x100u << 18, .flags = DAHL_CAN_FRAME_EXTENDED}, {.id = 0x100}, {.id = 0x7FF},
        {.id = (0x100u << 18) - 1, .flags = DAHL_CAN_FRAME_EXTENDED}, {.id = 0x0FF}};
    static const size_t want[] = {5, 4, 2, 1, 0, 3};
    dahl_can_frame_t out;
    timed_loopback_open(&timed, 1000000, (dahl_can_clock_t){.now_ns = now, .wait_us = wait_on});
    for (size_t i = 0; i < 6; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&timed.bus, &frames[i]));
    }
    for (size_t i = 0; i < 6; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&timed.bus, &out, 1000));
        TEST_ASSERT_EQUAL_HEX32(frames[want[i]].id, out.id);
    }
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&timed.bus, &out, 0));
}

/* Who asks when a frame is on its way waits for its end, whatever its id; equal ids go in the order of asking. */
static void test_a_frame_on_its_way_is_not_interrupted(void)
{
    static timed_loopback_t timed;
    static const dahl_can_frame_t frames[] = {
        {.id = 0x300}, {.id = 0x200, .length = 1, .data = {1}}, {.id = 0x200, .length = 1, .data = {2}}, {.id = 0x100}};
    static const size_t want[] = {0, 3, 1, 2};
    dahl_can_frame_t out;
    timed_loopback_open(&timed, 1000000, (dahl_can_clock_t){.now_ns = now, .wait_us = wait_on});
    for (size_t i = 0; i < 4; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&timed.bus, &frames[i]));
        clock_ns += 10000; /* a frame takes 45 us and more */
    }
    for (size_t i = 0; i < 4; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&timed.bus, &out, 1000));
        TEST_ASSERT_EQUAL_HEX32(frames[want[i]].id, out.id);
        TEST_ASSERT_EQUAL(frames[want[i]].data[0], out.data[0]);
    }
}

/* A frame that ends after the time to wait stays; so much time has passed then, and no more where a frame comes before. */
static void test_a_timed_bus_takes_its_time(void)
{
    static timed_loopback_t timed;
    const dahl_can_frame_t in = {.id = 0x555, .length = 0}; /* 44 bits and the pause of 3, nothing to stuff but in the CRC */
    dahl_can_frame_t out;
    timed_loopback_open(&timed, 125000, (dahl_can_clock_t){.now_ns = now, .wait_us = wait_on});
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&timed.bus, &out, 700));
    TEST_ASSERT_EQUAL(705000, clock_ns);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&timed.bus, &in));
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&timed.bus, &out, 300));
    TEST_ASSERT_EQUAL(1005000, clock_ns);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&timed.bus, &out, 300));
    TEST_ASSERT_GREATER_OR_EQUAL(705000 + 47 * 8000, clock_ns);
    TEST_ASSERT_LESS_OR_EQUAL(705000 + 50 * 8000, clock_ns);
    TEST_ASSERT_EQUAL(clock_ns / 1000, out.time_us);
    TEST_ASSERT_EQUAL(DAHL_CAN_FRAME_OWN, out.flags);
    for (size_t i = 0; i < TIMED_LOOPBACK_ROOM; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&timed.bus, &in));
    }
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_BUSY, dahl_can_bus_send(&timed.bus, &in));
    TEST_ASSERT_EQUAL(1, timed.bus.counts.dropped);
    TEST_ASSERT_EQUAL(0, timed.bus.ops->peers(&timed.bus));
}

/* By the standard's rules, counted outside this library: a remote frame has a length and no data. */
static void test_a_frame_takes_the_bits_of_its_form(void)
{
    static const struct {
        dahl_can_frame_t frame;
        uint32_t bits;
    } known[] = {
        {{.id = 0x123}, 48},
        {{.id = 0x123, .length = 8, .flags = DAHL_CAN_FRAME_REMOTE}, 48},
        {{.id = 0x000, .flags = DAHL_CAN_FRAME_REMOTE}, 50},
        {{.id = 0x000, .length = 8}, 127},
        {{.id = 0x7FF, .length = 8, .data = {255, 255, 255, 255, 255, 255, 255, 255}}, 126},
        {{.id = 0x12345678, .flags = DAHL_CAN_FRAME_EXTENDED}, 69},
        {{.id = 0x12345678, .length = 3, .flags = DAHL_CAN_FRAME_EXTENDED | DAHL_CAN_FRAME_REMOTE}, 68},
    };
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        TEST_ASSERT_EQUAL_UINT32_MESSAGE(known[i].bits, can_frame_bits(&known[i].frame), "frame by number");
    }
}

static void test_a_full_loopback_refuses_and_counts(void)
{
    dahl_can_frame_t in = {.length = 8};
    dahl_can_frame_t out;
    for (uint32_t i = 0; i < FRAME_QUEUE_SIZE; i++) {
        in.id = i;
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&loopback.bus, &in));
    }
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_BUSY, dahl_can_bus_send(&loopback.bus, &in));
    TEST_ASSERT_EQUAL(1, loopback.bus.counts.dropped);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&loopback.bus, &out, 0));
    TEST_ASSERT_EQUAL(0, out.id);
}

static void element_of(char *element, const char *text, size_t length)
{
    TEST_ASSERT_EQUAL('<', text[0]);
    TEST_ASSERT_EQUAL('>', text[length - 1]);
    TEST_ASSERT_LESS_OR_EQUAL(TEXT_FRAME_MAX, length);
    memcpy(element, text + 1, length - 2);
    element[length - 2] = '\0';
}

static dahl_can_frame_t random_frame(uint64_t *seed)
{
    bool extended = (random_u32(seed) & 1u) != 0;
    dahl_can_frame_t frame = {.flags = extended ? DAHL_CAN_FRAME_EXTENDED : 0, .length = (uint8_t)(random_u32(seed) % 9)};
    frame.id = random_u32(seed) & (extended ? 0x1FFFFFFFu : 0x7FFu);
    for (size_t i = 0; i < frame.length; i++) {
        frame.data[i] = (uint8_t)random_u32(seed);
    }
    return frame;
}

static void expect_same(const dahl_can_frame_t *a, const dahl_can_frame_t *b)
{
    TEST_ASSERT_EQUAL(a->id, b->id);
    TEST_ASSERT_EQUAL(a->flags, b->flags);
    TEST_ASSERT_EQUAL(a->length, b->length);
    TEST_ASSERT_EQUAL_MEMORY(a->data, b->data, 8);
    TEST_ASSERT_TRUE(a->time_us == b->time_us);
}

static void test_frames_survive_the_text_both_ways(void)
{
    uint64_t seed = 1;
    char text[TEXT_FRAME_MAX];
    char element[TEXT_FRAME_MAX];
    dahl_can_frame_t out;
    for (int i = 0; i < 20000; i++) {
        dahl_can_frame_t in = random_frame(&seed);
        element_of(element, text, text_from_send(text, &in));
        TEST_ASSERT_TRUE_MESSAGE(text_to_send(element, &out), element);
        expect_same(&in, &out);
        in.time_us = (uint64_t)random_u32(&seed) * 1000000u + random_u32(&seed) % 1000000u;
        element_of(element, text, text_from_frame(text, &in));
        TEST_ASSERT_TRUE_MESSAGE(text_to_frame(element, &out), element);
        expect_same(&in, &out);
    }
}

static void test_there_are_no_words_for_other_frames(void)
{
    char text[TEXT_FRAME_MAX];
    for (unsigned flags = 0; flags < 32; flags++) {
        dahl_can_frame_t frame = {.flags = (uint8_t)flags};
        bool plain = (flags & (DAHL_CAN_FRAME_REMOTE | DAHL_CAN_FRAME_ERROR | DAHL_CAN_FRAME_FD)) == 0;
        TEST_ASSERT_EQUAL(plain, text_from_frame(text, &frame) != 0);
        TEST_ASSERT_EQUAL(plain, text_from_send(text, &frame) != 0);
    }
}

/* The longest that there are, and not a character behind the last one. */
static void test_the_text_ends_where_its_length_says(void)
{
    char text[TEXT_FRAME_MAX];
    const dahl_can_frame_t frame = {
        .id = 0x1FFFFFFF, .flags = DAHL_CAN_FRAME_EXTENDED, .length = 8, .data = {1, 2, 3}, .time_us = UINT64_MAX};
    memset(text, '#', sizeof text);
    size_t length = text_from_frame(text, &frame);
    TEST_ASSERT_EQUAL_STRING_LEN("< frame 1FFFFFFF 18446744073709.551615 0102030000000000 >#", text, length + 1);
    memset(text, '#', sizeof text);
    length = text_from_send(text, &frame);
    TEST_ASSERT_EQUAL_STRING_LEN("< send 1FFFFFFF 8 01 02 03 00 00 00 00 00 >#", text, length + 1);
}

static void test_bad_elements_are_refused(void)
{
    static const char *const bad[] = {
        "", " ", " send", " send ", " send 123", " send 123 8", " send 123 1", " send 123 9 1 2 3 4 5 6 7 8 9",
        " send 123 c 0 0 0 0 0 0 0 0 0 0 0", " send 123 b 0 0 0 0 0 0 0 0 0 0 0", " send 123 c 0 0 0 0 0 0 0 0 0 0 0 100",
        " send 123 10c 0 0 0 0 0 0 0 0 0 0 0 0", " send 800 0", " send 20000000 0", " send 123456789 0", " send xyz 0",
        " send 123 1 100", " send 123 1 1 1", " send 123 -1", " send +12 0", " send 123 1 0x1g", " frame 123 0",
        " sendd 123 0", " send 123 1 ", " send 12 1 \xff", " send 123 1 0x1", " send 0x1 0", " send 123 1 \t1",
        " sendsend 123 0", " send 7FFFFFFFF 0", " send 123 1 1\xff", " send 123 0 \xff",
        " send 123 1 000000001", " send 000000123 0"};
    static const char *const bad_frames[] = {
        " frame", " frame 123", " frame xyz 1.000000 00", " frame 123 1000000 00", " frame 123 1.5 00", " frame 123 x.000000 00",
        " frame 123 .000000 00", " frame 123 -1.000000 00", " frame 123 1.-00001 00", " frame 123 1.00000x 00",
        " frame 123 1a.000000 00", " frame 123 1.000000 \xff",
        " frame 123 0000000000000000000000001.000000 00", " frame 123 1.00000a 00",
        " frame 123 1.0000000 00", " frame 123 9223372036855.000000 00", " frame 123 99999999999999999999.000000 00",
        " frame 123 123456789012345678901234.000000 00", " frame 123 1.000000 0", " frame 123 1.000000 0g",
        " frame 123 1.000000 0x", " frame 123 1.000000 001122334455667", " frame 123 1.000000 00112233445566778",
        " frame 123 1.000000 001122334455667788", " frame 123 1.000000 00112233445566778899aabbccdd", " frame 123 1.000000 00 11", " send 123 1.000000 00", " framed 123 1.000000 00"};
    dahl_can_frame_t frame;
    char longer[200];
    sprintf(longer, " frame 123 1.000000 %0130d", 0); /* 65 bytes in one word */
    TEST_ASSERT_FALSE(text_to_frame(longer, &frame));
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        TEST_ASSERT_FALSE_MESSAGE(text_to_send(bad[i], &frame), bad[i]);
    }
    for (size_t i = 0; i < sizeof bad_frames / sizeof bad_frames[0]; i++) {
        TEST_ASSERT_FALSE_MESSAGE(text_to_frame(bad_frames[i], &frame), bad_frames[i]);
    }
    TEST_ASSERT_TRUE(text_to_frame(" frame 7fF 9223372036854.999999 0011223344556677", &frame)); /* the most there can be */
    TEST_ASSERT_EQUAL_HEX32(0x7FF, frame.id);
    TEST_ASSERT_EQUAL(8, frame.length);
    TEST_ASSERT_EQUAL_HEX8(0x77, frame.data[7]);
    TEST_ASSERT_TRUE(frame.time_us == UINT64_C(9223372036854999999));
}

/* More than 8 bytes are CAN FD, which has a few lengths up to 64; the first 8 are kept. */
static void test_more_than_8_bytes_are_a_frame_of_can_fd(void)
{
    static const uint32_t lengths[] = {12, 16, 20, 24, 32, 48, 64};
    char send[TEXT_ELEMENT_MAX + 1];
    char taken[TEXT_ELEMENT_MAX + 1];
    dahl_can_frame_t frame;
    for (size_t i = 0; i < sizeof lengths / sizeof lengths[0]; i++) {
        int at = sprintf(send, " send 00000123 %X", (unsigned)lengths[i]), end = sprintf(taken, " frame 123 1.000000 ");
        for (uint32_t byte = 0; byte < lengths[i]; byte++) {
            at += sprintf(send + at, " %02X", (unsigned)byte);
            end += sprintf(taken + end, "%02X", (unsigned)byte);
        }
        TEST_ASSERT_TRUE(text_to_send(send, &frame));
        TEST_ASSERT_EQUAL(DAHL_CAN_FRAME_FD | DAHL_CAN_FRAME_EXTENDED, frame.flags);
        TEST_ASSERT_EQUAL(8, frame.length);
        TEST_ASSERT_EQUAL_MEMORY("\0\1\2\3\4\5\6\7", frame.data, 8);
        TEST_ASSERT_TRUE(text_to_frame(taken, &frame));
        TEST_ASSERT_EQUAL(DAHL_CAN_FRAME_FD, frame.flags);
        TEST_ASSERT_EQUAL_MEMORY("\0\1\2\3\4\5\6\7", frame.data, 8);
    }
}

/* Zeros before a number are part of it, as long as the word may be. */
static void test_words_as_long_as_they_may_be(void)
{
    dahl_can_frame_t frame;
    TEST_ASSERT_TRUE(text_to_send(" send 0000123 00000001 000000FF", &frame)); /* 7 digits: not extended */
    TEST_ASSERT_EQUAL_HEX32(0x123, frame.id);
    TEST_ASSERT_EQUAL(0, frame.flags);
    TEST_ASSERT_EQUAL(1, frame.length);
    TEST_ASSERT_EQUAL_HEX8(0xFF, frame.data[0]);
    TEST_ASSERT_TRUE(text_to_send(" send 1FFFFFFF 0", &frame));
    TEST_ASSERT_EQUAL_HEX32(0x1FFFFFFF, frame.id);
    TEST_ASSERT_EQUAL(DAHL_CAN_FRAME_EXTENDED, frame.flags);
    TEST_ASSERT_TRUE(text_to_frame(" frame 123 000000000000000000000010.000000", &frame));
    TEST_ASSERT_TRUE(frame.time_us == 10000000);
}

/* Nothing of the frame before it. */
static void test_what_an_element_does_not_say_is_0(void)
{
    const uint8_t none[8] = {0};
    dahl_can_frame_t frame;
    memset(&frame, 0xA5, sizeof frame);
    TEST_ASSERT_TRUE(text_to_frame(" frame 123 10.000000", &frame));
    TEST_ASSERT_EQUAL(0, frame.flags);
    TEST_ASSERT_EQUAL(0, frame.length);
    TEST_ASSERT_EQUAL_MEMORY(none, frame.data, 8);
    memset(&frame, 0xA5, sizeof frame);
    TEST_ASSERT_TRUE(text_to_send(" send 123 0", &frame));
    TEST_ASSERT_EQUAL_MEMORY(none, frame.data, 8);
    TEST_ASSERT_TRUE(frame.time_us == 0);
}

static uint32_t elements_in(text_splitter_t *splitter, const char *text)
{
    uint32_t count = 0;
    for (const char *c = text; *c != '\0'; c++) {
        count += text_feed(splitter, *c) ? 1u : 0u;
    }
    return count;
}

static void test_the_splitter_finds_elements_in_pieces_and_garbage(void)
{
    text_splitter_t splitter = {0};
    TEST_ASSERT_EQUAL(0, elements_in(&splitter, "< se"));
    TEST_ASSERT_EQUAL(1, elements_in(&splitter, "nd 1 0 >"));
    TEST_ASSERT_EQUAL_STRING(" send 1 0 ", splitter.element);
    TEST_ASSERT_EQUAL(2, elements_in(&splitter, "< a >\r\n < b >"));
    TEST_ASSERT_EQUAL(0, splitter.garbage);
    TEST_ASSERT_EQUAL(1, elements_in(&splitter, "xyz < cut < whole >"));
    TEST_ASSERT_EQUAL_STRING(" whole ", splitter.element);
    TEST_ASSERT_EQUAL(4, splitter.garbage);
}

/* Each element by itself, as long as it may be; nothing of the one before it, nothing of one too long. */
static void test_the_splitter_keeps_elements_apart(void)
{
    text_splitter_t splitter = {0};
    char longest[TEXT_ELEMENT_MAX + 4] = "<";
    memset(longest + 1, 'x', TEXT_ELEMENT_MAX + 1);
    TEST_ASSERT_EQUAL(1, elements_in(&splitter, "< first of them >"));
    TEST_ASSERT_EQUAL(1, elements_in(&splitter, "<b>"));
    TEST_ASSERT_EQUAL_STRING("b", splitter.element);
    longest[TEXT_ELEMENT_MAX + 1] = '>';
    TEST_ASSERT_EQUAL(1, elements_in(&splitter, longest));
    TEST_ASSERT_EQUAL(TEXT_ELEMENT_MAX, strlen(splitter.element));
    TEST_ASSERT_EQUAL(0, splitter.garbage);
    for (size_t i = 0; i < 2; i++) { /* one too long, ending in a character before or behind < in the alphabet */
        splitter.garbage = 0;
        longest[TEXT_ELEMENT_MAX + 1] = "1z"[i];
        TEST_ASSERT_EQUAL(0, elements_in(&splitter, longest));
        TEST_ASSERT_EQUAL(1, splitter.garbage);
        TEST_ASSERT_EQUAL(0, elements_in(&splitter, "ab>"));
        TEST_ASSERT_EQUAL(4, splitter.garbage);
    }
    TEST_ASSERT_EQUAL(1, elements_in(&splitter, "<c>"));
    TEST_ASSERT_EQUAL_STRING("c", splitter.element);
}

static void test_any_character_but_three_may_stand_in_an_element(void)
{
    for (int c = 1; c < 256; c++) {
        text_splitter_t splitter = {0};
        const char text[] = {'<', (char)c, '>', '\0'};
        const char wanted[] = {(char)c, '\0'};
        TEST_ASSERT_EQUAL(1, elements_in(&splitter, text));
        TEST_ASSERT_EQUAL_STRING(c == '<' || c == '>' ? "" : wanted, splitter.element);
        TEST_ASSERT_EQUAL(c == '<' || c == '>' ? 1 : 0, splitter.garbage);
    }
}

static void test_all_but_blanks_between_elements_is_garbage(void)
{
    for (int c = 1; c < 256; c++) {
        text_splitter_t splitter = {0};
        const char text[] = {(char)c, '\0'};
        bool silent = c == ' ' || c == '\n' || c == '\r' || c == '<';
        TEST_ASSERT_EQUAL(0, elements_in(&splitter, text));
        TEST_ASSERT_EQUAL(silent ? 0 : 1, splitter.garbage);
    }
}

static void test_words_are_what_stands_between_blanks(void)
{
    char word[4] = "old";
    const char *cursor = "one  two three 4  ";
    TEST_ASSERT_TRUE(text_word(&cursor, word, sizeof word));
    TEST_ASSERT_EQUAL_STRING("one", word);
    TEST_ASSERT_TRUE(text_word(&cursor, word, sizeof word));
    TEST_ASSERT_EQUAL_STRING("two", word);
    TEST_ASSERT_FALSE(text_word(&cursor, word, sizeof word)); /* too long: skipped, the word as it was */
    TEST_ASSERT_EQUAL_STRING("two", word);
    TEST_ASSERT_TRUE(text_word(&cursor, word, sizeof word));
    TEST_ASSERT_EQUAL_STRING("4", word);
    TEST_ASSERT_FALSE(text_word(&cursor, word, sizeof word));
    TEST_ASSERT_EQUAL_STRING("4", word);
    TEST_ASSERT_EQUAL('\0', *cursor);
    cursor = "four 5"; /* with its end it has no room */
    TEST_ASSERT_FALSE(text_word(&cursor, word, sizeof word));
    TEST_ASSERT_EQUAL_STRING("4", word);
    dahl_can_frame_t frame;
    TEST_ASSERT_TRUE(text_to_send("send   12345678  2 a   b", &frame));
    TEST_ASSERT_EQUAL_HEX32(0x12345678, frame.id);
    TEST_ASSERT_EQUAL_HEX8(0xB, frame.data[1]);
}

static void test_an_endless_element_is_dropped(void)
{
    text_splitter_t splitter = {0};
    text_feed(&splitter, '<');
    for (uint32_t i = 0; i < 100000; i++) {
        TEST_ASSERT_FALSE(text_feed(&splitter, 'a'));
        TEST_ASSERT_LESS_OR_EQUAL(TEXT_ELEMENT_MAX, splitter.length);
    }
    TEST_ASSERT_GREATER_THAN(0, splitter.garbage);
    TEST_ASSERT_EQUAL(1, elements_in(&splitter, "< good >"));
}

/* As a string it would be " hi ". */
static void test_a_0_makes_garbage_of_an_element(void)
{
    static const char hidden[] = "< hi \0x>";
    text_splitter_t splitter = {0};
    for (size_t i = 0; i < sizeof hidden - 1; i++) {
        TEST_ASSERT_FALSE(text_feed(&splitter, hidden[i]));
    }
    TEST_ASSERT_EQUAL(3, splitter.garbage); /* the element, x, > */
}

static void test_random_bytes_break_nothing(void)
{
    uint64_t seed = 3;
    text_splitter_t splitter = {0};
    dahl_can_frame_t frame;
    static const char alphabet[] = "<<>> send frame 0123456789ABCDEF.\n\xff";
    for (uint32_t i = 0; i < 2000000; i++) {
        if (text_feed(&splitter, alphabet[random_u32(&seed) % (sizeof alphabet - 1)])) {
            text_to_send(splitter.element, &frame);
            text_to_frame(splitter.element, &frame);
            TEST_ASSERT_LESS_OR_EQUAL(8, frame.length);
        }
    }
}

static outbox_t box;

static void test_an_outbox_takes_all_or_nothing(void)
{
    static char piece[1000];
    box.begin = 0;
    box.end = 0;
    for (size_t i = 0; i < OUTBOX_SIZE / sizeof piece; i++) {
        TEST_ASSERT_TRUE(outbox_put(&box, piece, sizeof piece));
    }
    TEST_ASSERT_FALSE(outbox_put(&box, piece, sizeof piece));
    TEST_ASSERT_TRUE(outbox_put(&box, piece, OUTBOX_SIZE % sizeof piece));
    box.begin = 500; /* as if the socket had taken 500 */
    TEST_ASSERT_FALSE(outbox_put(&box, piece, 501));
    TEST_ASSERT_TRUE(outbox_put(&box, piece, 500));
    TEST_ASSERT_EQUAL(OUTBOX_SIZE, box.end);
}

static dahl_can_frame_t taken;
static const char *to_read; /* what the host has sent and nobody has read yet */
static char written[200];

static bool read_port(uint8_t *byte)
{
    *byte = (uint8_t)*to_read;
    return *to_read != '\0' && to_read++ != NULL;
}

static void write_port(uint8_t byte)
{
    size_t length = strlen(written);
    TEST_ASSERT_LESS_THAN(sizeof written - 1, length);
    written[length] = (char)byte;
}

/* The host sends these lines; receive() takes them, and this is what it writes meanwhile. */
static dahl_can_result_t receive(serial_bus_t *serial, const char *lines, const char *answers)
{
    memset(written, 0, sizeof written);
    to_read = lines;
    dahl_can_result_t result = dahl_can_bus_receive(&serial->bus, &taken, 1000);
    TEST_ASSERT_EQUAL_STRING(answers, written);
    return result;
}

static const dahl_can_frame_t small = {.id = 0x100, .length = 2, .data = {0xAB, 0x12}};

static serial_bus_t opened(void)
{
    serial_bus_t serial;
    memset(&serial, 0xA5, sizeof serial);
    serial_bus_open(&serial, (serial_port_t){read_port, write_port}, (dahl_can_clock_t){.now_ns = now});
    return serial;
}

static void test_a_serial_bus_takes_frames_one_by_one_with_their_time(void)
{
    serial_bus_t serial = opened();
    clock_ns = 7654321;
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, receive(&serial, "O\rV\rt10", "\rV0101\r"));
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, receive(&serial, "02AB12\rt7FF0\r", "\r"));
    TEST_ASSERT_EQUAL_HEX32(0x100, taken.id);
    TEST_ASSERT_EQUAL_MEMORY(small.data, taken.data, 8);
    TEST_ASSERT_EQUAL(7654, taken.time_us);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, receive(&serial, to_read, "\r"));
    TEST_ASSERT_EQUAL_HEX32(0x7FF, taken.id);
    TEST_ASSERT_EQUAL(0, serial.bus.counts.garbage);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, receive(&serial, "z\rtx\r\r", "\a\a\r"));
    TEST_ASSERT_EQUAL(2, serial.bus.counts.garbage);
}

/* Nobody hears a node before the host has opened the bus, nor after one of the two has closed it. */
static void test_a_serial_bus_sends_while_it_is_open(void)
{
    const dahl_can_frame_t fd = {.id = 1, .flags = DAHL_CAN_FRAME_FD};
    serial_bus_t serial = opened();
    for (uint32_t times = 0; times < 2; times++) {
        TEST_ASSERT_EQUAL(0, serial.bus.ops->peers(&serial.bus));
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_BUSY, dahl_can_bus_send(&serial.bus, &small));
        TEST_ASSERT_EQUAL(2 * times + 1, serial.bus.counts.dropped);
        receive(&serial, "O\r", "\r");
        TEST_ASSERT_EQUAL(1, serial.bus.ops->peers(&serial.bus));
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&serial.bus, &small));
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_BUSY, dahl_can_bus_send(&serial.bus, &fd));
        TEST_ASSERT_EQUAL_STRING("\rt1002AB12\r", written);
        TEST_ASSERT_EQUAL(2 * times + 2, serial.bus.counts.dropped);
        serial.bus.ops->close(&serial.bus);
    }
    TEST_ASSERT_EQUAL(0, serial.bus.ops->peers(&serial.bus));
}

/* --- the client of socketcand --- */

static socketcand_member_t member;

/* In another process: greet, say words, and after a while tell how many elements came; NULL: leave after the first two. */
static void play_server(int listener, const char *words, int told)
{
    static const char greeting[] = "< hi >< ok >< ok >";
    char bytes[4096];
    uint32_t elements = 0, enough = words == NULL ? 2 : UINT32_MAX;
    alarm(20);
    int peer = accept(listener, NULL, NULL);
    ssize_t n = write(peer, greeting, sizeof greeting - 1);
    if (words != NULL) {
        n = write(peer, words, strlen(words));
        usleep(300000);
    }
    while (elements < enough && (n = read(peer, bytes, sizeof bytes)) > 0) {
        for (ssize_t i = 0; i < n; i++) {
            elements += bytes[i] == '>';
        }
    }
    _exit(write(told, &elements, sizeof elements) == (ssize_t)sizeof elements ? 0 : 1);
}

/* Join such a server; gives where it tells what came. */
static int join_server(const char *words)
{
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    int listener = socket(AF_INET, SOCK_STREAM, 0), ends[2];
    char port[8];
    TEST_ASSERT_EQUAL(0, bind(listener, (struct sockaddr *)&address, size));
    TEST_ASSERT_EQUAL(0, listen(listener, 1));
    TEST_ASSERT_EQUAL(0, getsockname(listener, (struct sockaddr *)&address, &size));
    TEST_ASSERT_EQUAL(0, pipe(ends));
    if (fork() == 0) {
        play_server(listener, words, ends[1]);
    }
    close(listener);
    close(ends[1]);
    sprintf(port, "%u", (unsigned)ntohs(address.sin_port));
    memset(&member, 0, sizeof member);
    dahl_can_clock_t clock = {.now_ns = now};
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, socketcand_join(&member, "127.0.0.1", port, "vcan0", clock));
    return ends[0];
}

/* Close the client; elements that have come to the server by then. */
static uint32_t leave_server(int told)
{
    uint32_t elements = 0;
    member.bus.ops->close(&member.bus);
    TEST_ASSERT_EQUAL(sizeof elements, read(told, &elements, sizeof elements));
    close(told);
    TEST_ASSERT_GREATER_THAN(0, wait(NULL));
    return elements;
}

/* The server reads late, and the socket holds little: what waits in the client when it closes comes through. */
static void test_closing_a_client_sends_what_is_still_queued(void)
{
    const int small_buffer = 4096;
    dahl_can_frame_t out = {.id = 0x123, .length = 8}, back;
    uint32_t sent = 0;
    int told = join_server("");
    setsockopt(member.fd, SOL_SOCKET, SO_SNDBUF, &small_buffer, sizeof small_buffer);
    for (; sent < 100000 && member.outbox.end - member.outbox.begin < OUTBOX_SIZE / 2; sent++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&member.bus, &out));
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&member.bus, &back, 0));
        TEST_ASSERT_EQUAL(DAHL_CAN_FRAME_OWN, back.flags);
    }
    TEST_ASSERT_GREATER_THAN(0, member.outbox.end - member.outbox.begin);
    TEST_ASSERT_EQUAL(sent + 2, leave_server(told)); /* after open and rawmode */
}

/* Seen by who only listens, too. */
static void test_a_client_sees_that_the_server_has_left(void)
{
    dahl_can_frame_t out;
    dahl_can_result_t result = DAHL_CAN_BUS_NONE;
    int told = join_server(NULL);
    for (int i = 0; i < 20 && result == DAHL_CAN_BUS_NONE; i++) {
        result = dahl_can_bus_receive(&member.bus, &out, 100000);
    }
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_GONE, result);
    leave_server(told);
}

static void test_a_client_takes_frames_and_counts_what_is_none(void)
{
    dahl_can_frame_t out;
    int told = join_server("< frame 123 1.000002 AB >xy< ok >< frame 12345678 7.5 >< frame 7FF 12.345678 >");
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&member.bus, &out, 2000000));
    TEST_ASSERT_EQUAL_HEX32(0x123, out.id);
    TEST_ASSERT_EQUAL(1000002, out.time_us);
    TEST_ASSERT_EQUAL(0, out.flags);
    TEST_ASSERT_EQUAL_HEX8(0xAB, out.data[0]);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&member.bus, &out, 2000000));
    TEST_ASSERT_EQUAL(12345678, out.time_us);
    TEST_ASSERT_EQUAL(4, member.bus.counts.garbage);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&member.bus, &out, 1000));
    TEST_ASSERT_EQUAL(2, leave_server(told));
}

/* Own frames come back with their time, as many as there is room for; what has no room is not sent either. */
static void test_a_client_with_a_full_queue_refuses_and_counts(void)
{
    const dahl_can_frame_t in = {.id = 0x123, .length = 1, .data = {7}};
    dahl_can_frame_t back;
    int told = join_server("");
    clock_ns = 7654321;
    TEST_ASSERT_EQUAL(1, member.bus.ops->peers(&member.bus));
    for (uint32_t i = 0; i < FRAME_QUEUE_SIZE; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&member.bus, &in));
    }
    clock_ns = 9000000;
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_BUSY, dahl_can_bus_send(&member.bus, &in));
    TEST_ASSERT_EQUAL(1, member.bus.counts.dropped);
    for (uint32_t i = 0; i < FRAME_QUEUE_SIZE; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&member.bus, &back, 0));
        TEST_ASSERT_EQUAL(7654, back.time_us);
        TEST_ASSERT_EQUAL(7, back.data[0]);
    }
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&member.bus, &back, 0));
    TEST_ASSERT_EQUAL(FRAME_QUEUE_SIZE + 2, leave_server(told));
}

/* SPDX-License-Identifier: MIT */
/* Loopback, the bus over a serial port, the text of the socketcand protocol, and its client beside a server that
 * misbehaves. All else of the sockets is tested from Python, by python-can. */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#include <unity.h>

#include "dahl_frames.h"
#include "frame_bits.h"
#include "frame_queue.h"
#include "loopback/loopback.h"
#include "random.h"
#include "slcan/serial_bus.h"
#include "socketcand/client.h"
#include "socketcand/outbox.h"
#include "socketcand/text.h"

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
    loopback_open(&loopback, 0, (dahl_can_clock_t){.now_ns = now, .wait_us = wait_us});
}

void tearDown(void)
{
}

/* Without a bit rate: as many as there is room for, in the order of sending, each with the time of sending. */
static void test_loopback_gives_back_in_order_what_it_has_room_for(void)
{
    dahl_can_frame_t in = {.length = 8}, out;
    for (uint32_t i = 0; i < LOOPBACK_ROOM; i++) {
        clock_ns = i * UINT64_C(1000000);
        in.id = LOOPBACK_ROOM - i;
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&loopback.bus, &in));
    }
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_BUSY, dahl_can_bus_send(&loopback.bus, &in));
    TEST_ASSERT_EQUAL(1, loopback.bus.counts.dropped);
    for (uint32_t i = 0; i < LOOPBACK_ROOM; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&loopback.bus, &out, 0));
        TEST_ASSERT_EQUAL(LOOPBACK_ROOM - i, out.id);
        TEST_ASSERT_EQUAL(i * 1000u, out.time_us);
        TEST_ASSERT_EQUAL(DAHL_CAN_FRAME_OWN, out.flags);
    }
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 0));
}

/* Also when the ring's free-running numbers wrap. */
static void test_a_frame_queue_gives_back_in_order_what_it_has_room_for(void)
{
    static frame_queue_t queue;
    dahl_can_frame_t frame = {.length = 8};
    queue.head = queue.tail = UINT32_MAX - 3;
    for (frame.id = 0; frame.id < FRAME_QUEUE_SIZE; frame.id++) {
        TEST_ASSERT_EQUAL(FRAME_QUEUE_SIZE - frame.id, frame_queue_room(&queue));
        TEST_ASSERT_TRUE(frame_queue_put(&queue, &frame));
    }
    TEST_ASSERT_FALSE(frame_queue_put(&queue, &frame));
    for (uint32_t i = 0; i < FRAME_QUEUE_SIZE; i++) {
        TEST_ASSERT_TRUE(frame_queue_take(&queue, &frame));
        TEST_ASSERT_EQUAL(i, frame.id);
    }
    TEST_ASSERT_FALSE(frame_queue_take(&queue, &frame));
}

/* A clock without a wait, as a firmware's: then there is none. Nobody else is there, and closing keeps what was sent. */
static void test_an_empty_loopback_waits_by_the_clock(void)
{
    dahl_can_frame_t in = {.id = 5, .length = 1, .data = {9}}, out;
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 0));
    TEST_ASSERT_EQUAL(0, waited_us);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 700));
    TEST_ASSERT_EQUAL(700, waited_us);
    loopback_open(&loopback, 0, (dahl_can_clock_t){.now_ns = now});
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 700));
    TEST_ASSERT_EQUAL(700, waited_us);
    TEST_ASSERT_EQUAL(0, loopback.bus.ops->peers(&loopback.bus));
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&loopback.bus, &in));
    loopback.bus.ops->close(&loopback.bus);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&loopback.bus, &out, 0));
    TEST_ASSERT_EQUAL(5, out.id);
    TEST_ASSERT_EQUAL(9, out.data[0]);
}

static void wait_on(void *context, uint32_t us)
{
    (void)context;
    clock_ns += us * UINT64_C(1000);
}

static void open_timed(uint32_t bitrate)
{
    loopback_open(&loopback, bitrate, (dahl_can_clock_t){.now_ns = now, .wait_us = wait_on});
}

typedef struct {
    const dahl_can_frame_t *frames;
    size_t count;
    uint8_t order[6];  /* in which they are carried */
    uint32_t pause_ns;    /* from one to the next that asks; a frame takes 45 us and more */
} priority_case_t;

/* By the standard's arbitration an id of 11 bits wins over one of 29 that begins with it. A frame on its way is not
 * interrupted; equal ids go in the order of asking. */
static void test_the_highest_priority_of_those_that_have_asked_goes_first(void)
{
    static const dahl_can_frame_t at_once[] = {
        {.id = 0x101}, {.id = 0x100u << 18, .flags = DAHL_CAN_FRAME_EXTENDED}, {.id = 0x100}, {.id = 0x7FF},
        {.id = (0x100u << 18) - 1, .flags = DAHL_CAN_FRAME_EXTENDED}, {.id = 0x0FF}};
    static const dahl_can_frame_t later[] = {
        {.id = 0x300}, {.id = 0x200, .length = 1, .data = {1}}, {.id = 0x200, .length = 1, .data = {2}}, {.id = 0x100}};
    static const priority_case_t cases[] = {{at_once, 6, {5, 4, 2, 1, 0, 3}, 0},
                                            {later, 4, {0, 3, 1, 2}, 10000}};
    dahl_can_frame_t out;
    for (const priority_case_t *c = cases; c < cases + 2; c++) {
        open_timed(1000000);
        for (size_t i = 0; i < c->count; i++) {
            TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&loopback.bus, &c->frames[i]));
            clock_ns += c->pause_ns;
        }
        for (size_t i = 0; i < c->count; i++) {
            TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&loopback.bus, &out, 1000));
            TEST_ASSERT_EQUAL_HEX32(c->frames[c->order[i]].id, out.id);
            TEST_ASSERT_EQUAL(c->frames[c->order[i]].data[0], out.data[0]);
        }
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 0));
    }
}

/* A frame that ends after the time to wait stays; so much time has passed then, and no more where a frame comes before. */
static void test_a_timed_bus_takes_its_time(void)
{
    const dahl_can_frame_t in = {.id = 0x555, .length = 0}; /* 44 bits and the pause of 3, nothing to stuff but in the CRC */
    dahl_can_frame_t out;
    open_timed(125000);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 700));
    TEST_ASSERT_EQUAL(705000, clock_ns);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&loopback.bus, &in));
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, dahl_can_bus_receive(&loopback.bus, &out, 300));
    TEST_ASSERT_EQUAL(1005000, clock_ns);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&loopback.bus, &out, 300));
    TEST_ASSERT_GREATER_OR_EQUAL(705000 + 47 * 8000, clock_ns);
    TEST_ASSERT_LESS_OR_EQUAL(705000 + 50 * 8000, clock_ns);
    TEST_ASSERT_EQUAL(clock_ns / 1000, out.time_us);
    TEST_ASSERT_EQUAL(DAHL_CAN_FRAME_OWN, out.flags);
    for (size_t i = 0; i < LOOPBACK_TIMED_ROOM; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&loopback.bus, &in));
    }
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_BUSY, dahl_can_bus_send(&loopback.bus, &in));
    TEST_ASSERT_EQUAL(1, loopback.bus.counts.dropped);
    TEST_ASSERT_EQUAL(0, loopback.bus.ops->peers(&loopback.bus));
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

/* For a frame that is not plain there are no words; the longest text, and not a character behind the last one. */
static void test_what_has_words_and_where_they_end(void)
{
    static const char longest[] = "< frame 1FFFFFFF 18446744073709.551615 0102030000000000 >#";
    static const char longest_send[] = "< send 1FFFFFFF 8 01 02 03 00 00 00 00 00 >#";
    char text[TEXT_FRAME_MAX];
    dahl_can_frame_t frame = {.id = 0x1FFFFFFF, .length = 8, .data = {1, 2, 3}, .time_us = UINT64_MAX};
    for (unsigned flags = 0; flags < 32; flags++) {
        frame.flags = (uint8_t)flags;
        bool plain = (flags & (DAHL_CAN_FRAME_REMOTE | DAHL_CAN_FRAME_ERROR | DAHL_CAN_FRAME_FD)) == 0;
        TEST_ASSERT_EQUAL(plain, text_from_frame(text, &frame) != 0);
        TEST_ASSERT_EQUAL(plain, text_from_send(text, &frame) != 0);
    }
    frame.flags = DAHL_CAN_FRAME_EXTENDED;
    memset(text, '#', sizeof text);
    TEST_ASSERT_EQUAL(sizeof longest - 2, text_from_frame(text, &frame));
    TEST_ASSERT_EQUAL_STRING_LEN(longest, text, sizeof longest - 1);
    memset(text, '#', sizeof text);
    TEST_ASSERT_EQUAL(sizeof longest_send - 2, text_from_send(text, &frame));
    TEST_ASSERT_EQUAL_STRING_LEN(longest_send, text, sizeof longest_send - 1);
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
}

/* A bad send is no unknown command: the server counts it and does not answer it. */
static void test_a_send_is_known_by_its_first_word(void)
{
    TEST_ASSERT_TRUE(text_is_send(" send 123 1 00 "));
    TEST_ASSERT_TRUE(text_is_send(" send xyz "));
    TEST_ASSERT_FALSE(text_is_send(" sendd 123 0 "));
    TEST_ASSERT_FALSE(text_is_send(" bcmmode "));
    TEST_ASSERT_FALSE(text_is_send(" "));
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

/* Zeros before a number are part of it, as long as the word may be; blanks between words are as many as one likes. What an
 * element does not say is 0, and nothing of the frame before it. */
static void test_good_elements_in_odd_forms(void)
{
    static const struct {
        bool (*read)(const char *, dahl_can_frame_t *);
        const char *element;
        dahl_can_frame_t frame;
    } good[] = {
        {text_to_send, " send 0000123 00000001 000000FF", {.id = 0x123, .length = 1, .data = {0xFF}}}, /* not extended */
        {text_to_send, " send 1FFFFFFF 0", {.id = 0x1FFFFFFF, .flags = DAHL_CAN_FRAME_EXTENDED}},
        {text_to_send, "send   12345678  2 a   b", {.id = 0x12345678, .flags = DAHL_CAN_FRAME_EXTENDED, .length = 2, .data = {10, 11}}},
        {text_to_send, " send 123 0", {.id = 0x123}},
        {text_to_frame, " frame 123 000000000000000000000010.000000", {.id = 0x123, .time_us = 10000000}},
        {text_to_frame, " frame 7fF 9223372036854.999999 0011223344556677", /* the most there can be */
         {.id = 0x7FF, .length = 8, .data = {0, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77}, .time_us = UINT64_C(9223372036854999999)}},
    };
    dahl_can_frame_t frame;
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        memset(&frame, 0xA5, sizeof frame);
        TEST_ASSERT_TRUE_MESSAGE(good[i].read(good[i].element, &frame), good[i].element);
        expect_same(&good[i].frame, &frame);
    }
}

static void test_words_are_what_stands_between_blanks(void)
{
    static const struct {
        bool found;
        const char *word; /* what stands there afterwards */
    } wanted[] = {{true, "one"}, {true, "two"}, {false, "two"}, {true, "4"}, {false, "4"}}; /* "three" has no room */
    char word[4] = "old";
    const char *cursor = "one  two three 4  ";
    for (size_t i = 0; i < sizeof wanted / sizeof wanted[0]; i++) {
        TEST_ASSERT_EQUAL(wanted[i].found, text_word(&cursor, word, sizeof word));
        TEST_ASSERT_EQUAL_STRING(wanted[i].word, word);
    }
    TEST_ASSERT_EQUAL('\0', *cursor);
    cursor = "four 5"; /* with its end it has no room */
    TEST_ASSERT_FALSE(text_word(&cursor, word, sizeof word));
    TEST_ASSERT_EQUAL_STRING("4", word);
}

/* Of whole bytes at once: where the piece that begins at `at` ends; *element says whether it is an element. */
static size_t piece_end(const char *bytes, size_t at, size_t length, bool *element)
{
    size_t end = at + 1;
    while (end < length && strchr("<>", bytes[end]) == NULL && end - at <= TEXT_ELEMENT_MAX) { /* a 0 is found, too */
        end++;
    }
    *element = end < length && bytes[end] == '>';
    return end;
}

/* Elements and garbage of a text, piece by piece, beside what the splitter makes of it letter by letter. */
static void compare_splitter(const char *bytes, size_t length)
{
    text_splitter_t splitter = {0};
    uint64_t garbage = 0;
    size_t fed = 0;
    for (size_t at = 0; at < length;) {
        bool element = false;
        size_t end = bytes[at] == '<' ? piece_end(bytes, at, length, &element) : at;
        garbage += element || end == length || (end == at && strchr(" \r\n", bytes[at]) != NULL && bytes[at] != '\0') ? 0 : 1;
        for (; fed < length && fed < end; fed++) {
            TEST_ASSERT_FALSE(text_feed(&splitter, bytes[fed]));
        }
        if (fed < length) {
            TEST_ASSERT_EQUAL(element, text_feed(&splitter, bytes[fed++]));
        }
        if (element) {
            TEST_ASSERT_EQUAL(end - at - 1, strlen(splitter.element));
            TEST_ASSERT_EQUAL_STRING_LEN(bytes + at + 1, splitter.element, end - at - 1);
        }
        TEST_ASSERT_EQUAL_UINT64(garbage, splitter.garbage);
        at = end < length && end > at && bytes[end] == '<' ? end : end + 1;
    }
}

/* Whatever comes, an element at its longest and one letter more; what is found is a frame or refused. */
static void test_the_splitter_finds_elements_in_pieces_and_garbage(void)
{
    static const char alphabet[] = "<<<>>> send frame 0123456789ABCDEF.\r\n\xff;=?\x01";
    char bytes[600];
    uint64_t seed = 3;
    for (uint32_t run = 0; run < 3000; run++) {
        size_t length = random_u32(&seed) % sizeof bytes;
        for (size_t i = 0; i < length; i++) {
            bool any = random_u32(&seed) % 16 == 0; /* also 0, and all that are in no word */
            bytes[i] = any ? (char)random_u32(&seed) : alphabet[random_u32(&seed) % (sizeof alphabet - 1)];
        }
        if (run % 4 == 0 && length > 330) { /* a long one, ended by > or by something else */
            memset(bytes + 50, 'x', 270);
            bytes[50] = '<';
            bytes[50 + TEXT_ELEMENT_MAX + run / 4 % 4] = "><1z"[run / 16 % 4];
        }
        compare_splitter(bytes, length);
    }
}

static void test_random_elements_are_frames_or_refused(void)
{
    static const char alphabet[] = "<<>> send frame 0123456789ABCDEF.\n\xff";
    uint64_t seed = 3;
    text_splitter_t splitter = {0};
    dahl_can_frame_t frame;
    for (uint32_t i = 0; i < 1000000; i++) {
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

static int send_error; /* of the next send(); 0: it is the kernel's */

ssize_t send(int fd, const void *bytes, size_t count, int flags)
{
    if (send_error == 0) {
        return sendto(fd, bytes, count, flags, NULL, 0);
    }
    errno = send_error;
    send_error = 0;
    return -1;
}

/* Flush once with this error of the socket, and once without: what arrives, and whether the peer counts as gone. */
static void check_flush(int error, bool stays)
{
    int ends[2];
    char bytes[8];
    TEST_ASSERT_EQUAL(0, socketpair(AF_UNIX, SOCK_STREAM, 0, ends));
    box.begin = box.end = 0;
    outbox_put(&box, "frame", 5);
    send_error = error;
    TEST_ASSERT_EQUAL_MESSAGE(stays, outbox_flush(&box, ends[0]), strerror(error));
    TEST_ASSERT_FALSE(outbox_empty(&box));
    TEST_ASSERT_TRUE(outbox_flush(&box, ends[0]));
    TEST_ASSERT_EQUAL(5, read(ends[1], bytes, sizeof bytes));
    close(ends[0]);
    close(ends[1]);
}

static void test_an_outbox_keeps_what_a_socket_does_not_take_now(void)
{
    static const int later[] = {EAGAIN, EINTR, ENOBUFS}, gone[] = {EPIPE, ECONNRESET};
    for (size_t i = 0; i < sizeof later / sizeof later[0]; i++) {
        check_flush(later[i], true);
    }
    for (size_t i = 0; i < sizeof gone / sizeof gone[0]; i++) {
        check_flush(gone[i], false);
    }
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

/* The server reads late, and the socket holds little: frames that wait in the client when it closes arrive, also if it has
 * not read all that the server sent. */
static void check_closing_sends_what_is_queued(const char *unread)
{
    const int small_buffer = 4096;
    dahl_can_frame_t out = {.id = 0x123, .length = 8}, back;
    uint32_t sent = 0;
    int told = join_server(unread);
    setsockopt(member.fd, SOL_SOCKET, SO_SNDBUF, &small_buffer, sizeof small_buffer);
    for (; sent < 100000 && member.outbox.end - member.outbox.begin < OUTBOX_SIZE / 2; sent++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&member.bus, &out));
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&member.bus, &back, 0));
        TEST_ASSERT_EQUAL(DAHL_CAN_FRAME_OWN, back.flags);
    }
    TEST_ASSERT_GREATER_THAN(0, member.outbox.end - member.outbox.begin);
    TEST_ASSERT_EQUAL(sent + 2, leave_server(told)); /* after open and rawmode */
}

static void test_closing_a_client_sends_what_is_still_queued(void)
{
    check_closing_sends_what_is_queued("");
    check_closing_sends_what_is_queued("< frame 123 1.000000 AB >");
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

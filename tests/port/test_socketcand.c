/* SPDX-License-Identifier: MIT */
/* socketcand on simulated sockets: the properties of its fuzzer for random elements and sessions, the client, and its outbox.
 * tests/python connects python-can to the real server. */
#define _GNU_SOURCE
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "../fuzz/socketcand.c"
#include "random.h"

static uint64_t seed;

void setUp(void)
{
    seed = 3;
    play = (play_t){.now_ns = 1};
}

static uint32_t below(uint32_t n)
{
    return random_u32(&seed) % n;
}

/* --- properties of the fuzzer -------------------------------------------------------------------------------------- */

/* A good send or frame, with up to 64 bytes. */
static int random_element(char *text)
{
    static const uint8_t lengths[] = {0, 1, 2, 8, 12, 16, 20, 24, 32, 48, 64};
    const int is_send = (int)below(2), is_extended = (int)below(2);
    const uint32_t length = lengths[below(11)], id = random_u32(&seed) & (is_extended ? 0x1FFFFFFFu : 0x7FFu);
    int at = sprintf(text, is_extended ? "< %s %08X" : "< %s %03X", is_send ? "send" : "frame", (unsigned)id);
    at += is_send ? sprintf(text + at, " %X", (unsigned)length)
                  : sprintf(text + at, " %u%u.%06u%s", (unsigned)random_u32(&seed), (unsigned)below(20000), (unsigned)below(1000000),
                            length > 0 ? " " : "");
    for (uint32_t i = 0; i < length; i++) {
        at += sprintf(text + at, is_send ? " %02X" : "%02X", (unsigned)below(256));
    }
    return at + sprintf(text + at, " >");
}

static void test_random_elements_are_read_as_by_a_second_reader(void)
{
    static const char alphabet[] = "<> 0189aFg.-+x\t\xff\r;";
    char text[400];
    for (uint32_t run = 0; run < 100000; run++) {
        size_t length = (size_t)random_element(text);
        for (uint32_t changes = below(3); changes > 0; changes--) {
            text[below((uint32_t)length)] = alphabet[below(sizeof alphabet)]; /* the last one is 0 */
        }
        check_text((const uint8_t *)text, length);
    }
}

static void test_elements_at_their_limits_are_read_as_by_a_second_reader(void)
{
    static const char *const elements[] = {
        "", " ", " send", " send 123", " send 0000123 00000001 000000FF", " send 000000123 0", " send 123 1 000000001", " send 800 0",
        " send 7FFFFFFFF 0", " send 20000000 0", "send   12345678  2 a   b", " send 123 10c 0", " send 123 1 100", " sendd 123 0",
        " frame 123 0", " frame 123 000000000000000000000010.000000", " frame 123 0000000000000000000000001.000000 00",
        " frame 7fF 9223372036854.999999 0011223344556677", " frame 123 9223372036855.000000 00", " frame 123 1.0000000 00",
        " frame 123 99999999999999999999.000000 00", " frame 123 1.000000 0", " frame 123 1.000000 00 11", " framed 123 1.000000 00"};
    char longer[300];
    for (size_t i = 0; i < sizeof elements / sizeof elements[0]; i++) {
        check_words(elements[i]);
    }
    sprintf(longer, " frame 123 1.000000 %0130d", 0); /* 65 bytes */
    check_words(longer);
    for (int length = (int)TEXT_ELEMENT_MAX - 2; length <= (int)TEXT_ELEMENT_MAX + 2; length++) {
        sprintf(longer, "<%0*d>", length, 0);
        check_text((const uint8_t *)longer, strlen(longer));
    }
}

/* Sessions with changed, repeated and cut bytes; clients join, stop reading and leave at any time. */
static void test_random_sessions_hold_the_laws_of_server_and_client(void)
{
    static const char *const sessions[] = {
        "1\x08\x18@A\x0e< open vcan0 >A\x0b< rawmode >A\x12< send 123 1 FF >DDDPQ$< open vcan0 >< rawmode >< echo >ECBF",
        "2< hi >< ok >< ok >< frame 123 1.000000 11 >< frame 1ABCDEF0 2.000000  >xy< ok >"};
    for (uint32_t run = 0; run < 4000; run++) {
        const char *session = sessions[run % 2];
        uint8_t bytes[200];
        size_t length = strlen(session);
        memcpy(bytes, session, length);
        for (uint32_t changes = below(8); changes > 0; changes--) {
            bytes[1 + below((uint32_t)length - 1)] = (uint8_t)random_u32(&seed);
        }
        (void)LLVMFuzzerTestOneInput(bytes, length - below(10));
    }
    fuzz_at_random(2000, 256);
}

/* --- the server ---------------------------------------------------------------------------------------------------- */

static char said[PLAY_PEERS][200]; /* by the server, at first */

static void note(void *context, int peer, const char *bytes, size_t count)
{
    const size_t used = strlen(said[peer]);
    (void)context;
    memcpy(said[peer] + used, bytes, used + count < sizeof said[peer] ? count : 0);
}

static void start_server(void)
{
    clear_server();
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, socketcand_serve(&server, 0, "vcan0", clock_of_play));
}

/* A client connects and sends words. The server works for 200 ms. Return its last frame. */
static dahl_can_frame_t visit(int i, const char *words)
{
    dahl_can_frame_t frame = {.id = 0};
    memset(said[i], 0, sizeof said[i]);
    play.peers[i] = (play_peer_t){.waits_at_door = 1, .hears = note, .says = (const uint8_t *)words, .says_left = strlen(words)};
    for (int ms = 0; ms < 200; ms++) {
        (void)dahl_can_bus_receive(&server.bus, &frame, 1000);
    }
    return frame;
}

static void test_a_server_passes_frames_on_and_forgets_its_former_clients(void)
{
    static const char open[] = "< open vcan0 >< rawmode >", sends[] = "< open vcan0 >< rawmode >< send 123 1 FF >< echo >";
    static uint8_t blanks[9000]; /* more than one read */
    const uint64_t began_us = 5000000;
    char expected[80];
    memset(blanks, ' ', sizeof blanks);
    play.now_ns = began_us * 1000;
    start_server();
    (void)visit(0, "< send 12"); /* is cut, then leaves */
    play.peers[0].has_hung_up = 1;
    (void)visit(1, open);
    TEST_ASSERT_FALSE(play.peers[0].is_connected);
    const dahl_can_frame_t frame = visit(0, sends);
    TEST_ASSERT_EQUAL_HEX32(0x123, frame.id);
    TEST_ASSERT_TRUE(frame.time_us > began_us && frame.flags == 0 && server.bus.counts.garbage == 0);
    sprintf(expected, "< hi >< ok >< ok >< frame 123 5.%06u FF >", (unsigned)(frame.time_us - began_us));
    TEST_ASSERT_EQUAL_STRING(expected, said[1]);
    TEST_ASSERT_EQUAL_STRING("< hi >< ok >< ok >< echo >", said[0]); /* the sender does not receive its frame */
    TEST_ASSERT_EQUAL(2, server.bus.ops->peers(&server.bus));
    for (int silent = 0; silent < 2; silent++) {
        (void)visit(2, silent == 0 ? "" : "< open vcan0 >");
        TEST_ASSERT_TRUE(play.peers[2].is_connected);
        play.now_ns += SOCKETCAND_HANDSHAKE_MS * UINT64_C(1000000);
        for (int i = 0; i < 4; i++) {
            (void)dahl_can_bus_receive(&server.bus, &(dahl_can_frame_t){.id = 0}, 1000);
        }
        TEST_ASSERT_TRUE(!play.peers[2].is_connected && play.peers[1].is_connected);
    }
    play.peers[1].is_deaf = 1;
    for (uint32_t i = 0; i < FRAME_QUEUE_SIZE; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&server.bus, &frame));
    }
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_BUSY, dahl_can_bus_send(&server.bus, &frame));
    TEST_ASSERT_EQUAL(1, server.bus.counts.dropped);
    play.peers[1].says = blanks;
    play.peers[1].says_left = sizeof blanks;
    server.bus.ops->close(&server.bus);
    TEST_ASSERT_EQUAL(0, play.peers[1].says_left); /* a close with unread input would reset the connection */
}

#define RAW "< open vcan0 >< rawmode >"
#define NO_BUS "< error could not open bus >"
#define UNKNOWN "< error unknown command >"

/* A connected client sends more words. */
static void speak(int i, const char *words)
{
    dahl_can_frame_t frame;
    play.peers[i].says = (const uint8_t *)words;
    play.peers[i].says_left = strlen(words);
    for (int ms = 0; ms < 10; ms++) {
        (void)dahl_can_bus_receive(&server.bus, &frame, 1000);
    }
}

static void test_commands_have_their_answers_in_each_stage(void)
{
    static const struct {
        const char *words, *answers; /* after < hi > */
        uint32_t garbage;
    } cases[] = {
        {"< open can7 >< open vcan >< open vcan01 >< open >", NO_BUS NO_BUS NO_BUS NO_BUS, 0},
        {"< rawmode >< send 7FF 0 >< hello >< >< echo >", UNKNOWN UNKNOWN UNKNOWN UNKNOWN "< echo >", 4},
        {"< open vcan0 >< open can7 >< send 7FF 0 >< rawmode >< echo >", "< ok >" NO_BUS UNKNOWN "< ok >< echo >", 1},
        {RAW "< open vcan0 >< rawmode >< add 1 0 123 1 1 >", "< ok >< ok >" UNKNOWN UNKNOWN UNKNOWN, 3},
        {RAW "< send 123 9 1 >< send 800 0 >< send 7FF >< send 7FF 1 >< send 7FF 0 >", "< ok >< ok >", 4},
        {"abc\n \t> x< cut < open vcan0 >", "< ok >", 3 + 1 + 2 + 1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        play = (play_t){.now_ns = 1};
        start_server();
        (void)visit(0, cases[i].words);
        TEST_ASSERT_EQUAL_STRING(cases[i].answers, said[0] + strlen("< hi >"));
        TEST_ASSERT_EQUAL(cases[i].garbage, server.bus.counts.garbage);
        speak(0, "xyz");
        TEST_ASSERT_EQUAL(cases[i].garbage + 3, server.bus.counts.garbage);
        server.bus.ops->close(&server.bus);
    }
}

static void test_a_client_is_a_peer_from_its_first_frame_in_raw_mode_on(void)
{
    start_server();
    (void)visit(0, "< open vcan0 >");
    speak(0, "< rawmode >");
    TEST_ASSERT_EQUAL(0, server.bus.ops->peers(&server.bus));
    speak(0, "< send 123 0 >");
    TEST_ASSERT_EQUAL(1, server.bus.ops->peers(&server.bus));
    server.bus.ops->close(&server.bus);
}

static void test_unsent_bytes_of_a_client_do_not_reach_the_next(void)
{
    const dahl_can_frame_t frame = {.id = 0x123, .length = 8};
    start_server();
    (void)visit(0, RAW);
    play.peers[0].is_deaf = 1;
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&server.bus, &frame));
    play.peers[0].has_hung_up = 1;
    (void)visit(1, "");
    TEST_ASSERT_FALSE(play.peers[0].is_connected);
    TEST_ASSERT_EQUAL_STRING("< hi >", said[1]);
    server.bus.ops->close(&server.bus);
}

/* --- the client ---------------------------------------------------------------------------------------------------- */

static socketcand_member_t member;
static uint32_t elements; /* that the server has received */

static void count_elements(void *context, int peer, const char *bytes, size_t count)
{
    (void)context;
    (void)peer;
    for (size_t i = 0; i < count; i++) {
        elements += bytes[i] == '>';
    }
}

/* Join a server that says this text. */
static dahl_can_result_t join_by(const char *text)
{
    memset(&member, 0, sizeof member);
    elements = 0;
    play.peers[0] = (play_peer_t){.says = (const uint8_t *)text, .says_left = strlen(text), .hears = count_elements};
    return socketcand_join(&member, "host", "1", "vcan0", clock_of_play);
}

static play_peer_t *join_server(const char *words)
{
    static char text[400];
    sprintf(text, "< hi >< ok >< ok >%s", words);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, join_by(text));
    return &play.peers[0];
}

/* The server sends one byte at a time: 17 of them, after the time to connect. */
static void test_a_client_joins_within_its_time_or_gives_up_however_slow_the_server(void)
{
    enum { OK = DAHL_CAN_BUS_OK, FAILS = DAHL_CAN_BUS_ERROR };
    static const struct {
        uint32_t delay_ms;
        int dead_addresses;
        dahl_can_result_t result;
    } cases[] = {{0, 0, OK}, {250, 0, OK}, {300, 0, FAILS}, {1200, 0, FAILS}, {4900, 0, FAILS}, {6000, 0, FAILS},
                 {0, 1, OK}, {0, 3, OK}, {100, 1, OK}, {200, 1, FAILS}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        play = (play_t){.now_ns = 1, .delay_ns = cases[i].delay_ms * UINT64_C(1000000),
                        .dead_addresses = cases[i].dead_addresses};
        TEST_ASSERT_EQUAL(cases[i].result, join_by("< hi >< ok >< ok >"));
        TEST_ASSERT_TRUE(play.now_ns <= (SOCKETCAND_HANDSHAKE_MS + 10) * UINT64_C(1000000));
        TEST_ASSERT_EQUAL(cases[i].result == DAHL_CAN_BUS_OK ? 1 : 0, play.open);
    }
}

static void test_a_client_refuses_another_server_at_once(void)
{
    static const char *const words[] = {"SSH-2.0< hi >< ok >< ok >", "< hello >< ok >< ok >", "< hi >< error >< ok >",
                                        "< hi >< ok >x< ok >"};
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        play = (play_t){.now_ns = 1};
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_ERROR, join_by(words[i]));
        TEST_ASSERT_TRUE(errno == EPROTO && play.open == 0 && play.now_ns < 1000000);
    }
}

static dahl_can_result_t receive(dahl_can_frame_t *out)
{
    return dahl_can_bus_receive(&member.bus, out, 1000);
}

static void test_a_client_receives_frames_and_counts_garbage(void)
{
    dahl_can_frame_t out;
    (void)join_server("< frame 123 1.000002 AB >xy< ok >< frame 12345678 7.5 >< frame 7FF 12.345678 >");
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, receive(&out));
    TEST_ASSERT_EQUAL_HEX32(0x123, out.id);
    TEST_ASSERT_TRUE(out.time_us == 1000002 && out.flags == 0 && out.data[0] == 0xAB);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, receive(&out));
    TEST_ASSERT_EQUAL(12345678, out.time_us);
    TEST_ASSERT_EQUAL(4, member.bus.counts.garbage);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, receive(&out));
    play.peers[0].says = (const uint8_t *)"z";
    play.peers[0].says_left = 1;
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, receive(&out));
    TEST_ASSERT_EQUAL(5, member.bus.counts.garbage);
}

static void test_a_client_returns_gone_if_the_server_leaves(void)
{
    dahl_can_frame_t out;
    join_server("")->has_hung_up = 1;
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_GONE, receive(&out));
}

/* Own frames return with the time of sending. A frame without room is not sent, and none is read. */
static void test_a_client_with_a_full_queue_refuses_and_counts(void)
{
    const dahl_can_frame_t in = {.id = 0x123, .length = 1, .data = {7}};
    dahl_can_frame_t back;
    (void)join_server("< frame 7FF 1.000000 >");
    TEST_ASSERT_EQUAL(1, member.bus.ops->peers(&member.bus));
    play.now_ns = 7654321;
    for (uint32_t i = 0; i < FRAME_QUEUE_SIZE; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&member.bus, &in));
    }
    play.now_ns = 9000000;
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_BUSY, dahl_can_bus_send(&member.bus, &in));
    TEST_ASSERT_EQUAL(1, member.bus.counts.dropped);
    for (uint32_t i = 0; i < FRAME_QUEUE_SIZE; i++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, receive(&back));
        TEST_ASSERT_TRUE(back.time_us == 7654 && back.data[0] == 7 && back.flags == DAHL_CAN_FRAME_OWN);
    }
    TEST_ASSERT_TRUE(receive(&back) == DAHL_CAN_BUS_OK && back.id == 0x7FF && member.bus.counts.dropped == 1);
    TEST_ASSERT_EQUAL(DAHL_CAN_BUS_NONE, receive(&back));
    member.bus.ops->close(&member.bus);
    TEST_ASSERT_EQUAL(FRAME_QUEUE_SIZE + 2, elements); /* after open and rawmode */
}

/* The server does not read until the client closes, and has sent frames that the client has not read. A close with unread input
 * would reset the connection and lose frames on their way. */
static void test_closing_a_client_sends_its_queue_and_reads_its_input(void)
{
    const dahl_can_frame_t in = {.id = 0x123, .length = 8};
    dahl_can_frame_t back;
    play_peer_t *server_side = join_server("< frame 123 1.000000 AB >");
    server_side->is_deaf = 1;
    for (uint32_t sent = 0; sent < 100; sent++) {
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_send(&member.bus, &in));
        TEST_ASSERT_EQUAL(DAHL_CAN_BUS_OK, dahl_can_bus_receive(&member.bus, &back, 0));
    }
    TEST_ASSERT_EQUAL(2, elements);
    server_side->is_deaf = 0;
    server_side->room_per_poll = 1000;
    member.bus.ops->close(&member.bus);
    TEST_ASSERT_TRUE(server_side->has_seen_end); /* so that it closes */
    TEST_ASSERT_EQUAL(102, elements);
    TEST_ASSERT_EQUAL(0, server_side->says_left);
    TEST_ASSERT_EQUAL(0, play.open);
}

/* --- the outbox ---------------------------------------------------------------------------------------------------- */

static outbox_t box;

static void test_an_outbox_accepts_all_or_nothing(void)
{
    static char piece[1000];
    for (size_t i = 0; i < sizeof piece; i++) {
        piece[i] = (char)(i % 251);
    }
    box.begin = box.end = 0;
    for (size_t i = 0; i < OUTBOX_SIZE / sizeof piece; i++) {
        TEST_ASSERT_TRUE(outbox_put(&box, piece, sizeof piece));
    }
    TEST_ASSERT_FALSE(outbox_put(&box, piece, sizeof piece));
    TEST_ASSERT_TRUE(outbox_put(&box, piece, OUTBOX_SIZE % sizeof piece));
    box.begin = 500; /* as if the socket had accepted 500 bytes */
    TEST_ASSERT_FALSE(outbox_put(&box, piece, 501));
    TEST_ASSERT_TRUE(outbox_put(&box, piece, 500));
    TEST_ASSERT_EQUAL(OUTBOX_SIZE, box.end);
    TEST_ASSERT_EQUAL_MEMORY(piece + 500, box.bytes, 500); /* the rest has moved to the beginning */
}

/* A full socket keeps the connection, a broken one ends it; the bytes stay either way. */
static void test_an_outbox_keeps_its_bytes_on_each_error_of_the_socket(void)
{
    static const struct {
        int error;
        bool stays;
    } cases[] = {{EAGAIN, true}, {EINTR, true}, {ENOBUFS, true}, {EPIPE, false}, {ECONNRESET, false}};
    (void)join_server("");
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        box.begin = box.end = 0;
        elements = 0;
        outbox_put(&box, "<x>", 3);
        play.send_error = cases[i].error;
        TEST_ASSERT_EQUAL_MESSAGE(cases[i].stays, outbox_flush(&box, PLAY_FD), strerror(cases[i].error));
        TEST_ASSERT_FALSE(outbox_empty(&box));
        TEST_ASSERT_TRUE(outbox_flush(&box, PLAY_FD));
        TEST_ASSERT_EQUAL(1, elements);
    }
}

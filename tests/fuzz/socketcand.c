/* SPDX-License-Identifier: MIT */
/*
 * The socketcand protocol. A second reader checks its text. Up to three clients join the server, send any bytes in any pieces,
 * stop reading, or hang up. The client connects to a server that sends any bytes. The product must send elements of the
 * protocol only.
 */
#include <stddef.h>

#include "fuzz.h"
#include "socketcand/client.h"
#include "socketcand/server.h"
#include "sockets.h"

static uint64_t now_ns(void *context)
{
    (void)context;
    return play.now_ns;
}

static const dahl_can_clock_t clock_of_play = {now_ns, NULL, NULL};

static int is_frame(const dahl_can_frame_t *frame)
{
    int extended = (frame->flags & DAHL_CAN_FRAME_EXTENDED) != 0;
    return frame->id <= (extended ? 0x1FFFFFFFu : 0x7FFu) && frame->length <= 8 &&
           (frame->flags & ~(DAHL_CAN_FRAME_EXTENDED | DAHL_CAN_FRAME_OWN | DAHL_CAN_FRAME_FD | DAHL_CAN_FRAME_CUT)) == 0;
}

static int is_same(const dahl_can_frame_t *a, const dahl_can_frame_t *b)
{
    return a->id == b->id && a->flags == b->flags && a->length == b->length && memcmp(a->data, b->data, a->length) == 0;
}

/* --- text --------------------------------------------------------------------------------------------------------- */

enum { WORDS_MAX = 68, WORD_SIZE = 130 };

/* Split an element at spaces. Return -1 if a word is longer, or there are more words, than in any good element. */
static int words_of(const char *element, char words[WORDS_MAX][WORD_SIZE])
{
    int count = 0;
    for (size_t used = 0; *element != '\0'; element++) {
        used = *element == ' ' ? 0 : used + 1;
        if (used == 1 && ++count > WORDS_MAX) {
            return -1;
        }
        if (used >= WORD_SIZE) {
            return -1;
        }
        if (used > 0) {
            words[count - 1][used - 1] = *element;
            words[count - 1][used] = '\0';
        }
    }
    return count;
}

static int is_digits(const char *word, size_t least, size_t most, int hex)
{
    size_t length = strlen(word), good = strspn(word, hex ? "0123456789abcdefABCDEF" : "0123456789");
    return length >= least && length <= most && good == length;
}

static int read_id(const char *word, dahl_can_frame_t *frame)
{
    if (!is_digits(word, 1, 8, 1)) {
        return 0;
    }
    int extended = strlen(word) == 8;
    frame->id = (uint32_t)strtoul(word, NULL, 16);
    frame->flags = extended ? DAHL_CAN_FRAME_EXTENDED : 0;
    return frame->id <= (extended ? 0x1FFFFFFFu : 0x7FFu);
}

static int read_byte(const char *word, unsigned long most, uint8_t *byte)
{
    unsigned long value = strtoul(word, NULL, 16);
    *byte = (uint8_t)(value & 255u);
    return is_digits(word, 1, 8, 1) && value <= most;
}

static const char fd_lengths[] = "\14\20\24\30\40\60\100";

static int read_send(const char *element, dahl_can_frame_t *frame)
{
    char words[WORDS_MAX][WORD_SIZE];
    int count = words_of(element, words);
    *frame = (dahl_can_frame_t){0};
    if (count < 3 || strcmp(words[0], "send") != 0 || !read_id(words[1], frame)) {
        return 0;
    }
    uint8_t length, byte;
    int good = read_byte(words[2], 64, &length) && count == 3 + length && (length <= 8 || strchr(fd_lengths, length));
    for (int i = 0; good && i < length; i++) {
        good = read_byte(words[3 + i], 255, &byte);
        frame->data[i < 8 ? i : 7] = i < 8 ? byte : frame->data[7];
    }
    frame->length = length <= 8 ? length : 8;
    frame->flags |= length <= 8 ? 0 : DAHL_CAN_FRAME_FD | DAHL_CAN_FRAME_CUT;
    return good;
}

static int read_time(char *word, dahl_can_frame_t *frame)
{
    char *point = strchr(word, '.');
    if (point == NULL || strlen(word) > 31) {
        return 0;
    }
    *point = '\0';
    uint64_t seconds = strtoull(word, NULL, 10);
    frame->time_us = seconds * 1000000u + strtoull(point + 1, NULL, 10);
    return is_digits(word, 1, 31, 0) && is_digits(point + 1, 6, 6, 0) && seconds <= UINT64_MAX / 2000000u;
}

static int read_frame(const char *element, dahl_can_frame_t *frame)
{
    char words[WORDS_MAX][WORD_SIZE];
    int count = words_of(element, words);
    *frame = (dahl_can_frame_t){0};
    if (count < 3 || count > 4 || strcmp(words[0], "frame") != 0 || !read_id(words[1], frame) || !read_time(words[2], frame)) {
        return 0;
    }
    size_t length = count == 4 ? strlen(words[3]) / 2 : 0;
    frame->length = (uint8_t)(length <= 8 ? length : 8);
    frame->flags |= length <= 8 ? 0 : DAHL_CAN_FRAME_FD | DAHL_CAN_FRAME_CUT;
    for (size_t i = 0; i < frame->length; i++) {
        const char pair[] = {words[3][2 * i], words[3][2 * i + 1], '\0'};
        frame->data[i] = (uint8_t)strtoul(pair, NULL, 16);
    }
    return count == 3 || (is_digits(words[3], 2, 128, 1) && strlen(words[3]) % 2 == 0 && (length <= 8 || strchr(fd_lengths, (int)length)));
}

static void check_written(const dahl_can_frame_t *frame)
{
    char text[TEXT_FRAME_MAX + 1], element[TEXT_FRAME_MAX + 1];
    dahl_can_frame_t back;
    size_t length = text_from_frame(text, frame);
    if (frame->flags & (DAHL_CAN_FRAME_FD | DAHL_CAN_FRAME_REMOTE | DAHL_CAN_FRAME_ERROR)) {
        HOLDS(length == 0 && text_from_send(text, frame) == 0, "a remote, error or FD frame is not written");
        return;
    }
    HOLDS(length > 4 && length < TEXT_FRAME_MAX && text[0] == '<' && text[length - 1] == '>', "a frame is written as an element");
    memcpy(element, text + 1, length - 2);
    element[length - 2] = '\0';
    HOLDS(text_to_frame(element, &back) && is_same(&back, frame) && back.time_us == frame->time_us, "a written frame is read back");
    length = text_from_send(text, frame);
    HOLDS(length > 4 && length < TEXT_FRAME_MAX, "a send is written as an element");
    memcpy(element, text + 1, length - 2);
    element[length - 2] = '\0';
    HOLDS(text_to_send(element, &back) && is_same(&back, frame), "a written send is read back");
}

/* A send of more than 8 bytes is passed on with all of them. */
static void check_long_send(const char *element, const dahl_can_frame_t *frame)
{
    char words[WORDS_MAX][WORD_SIZE], text[TEXT_LONG_MAX + 1], wanted[400];
    int count = words_of(element, words);
    size_t length = text_from_long_send(text, element, frame);
    const int digits = frame->flags & DAHL_CAN_FRAME_EXTENDED ? 8 : 3;
    int at = sprintf(wanted, "< frame %0*X 0.000000 ", digits, (unsigned)frame->id);
    for (int i = 3; i < count; i++) {
        at += sprintf(wanted + at, "%02X", (unsigned)strtoul(words[i], NULL, 16));
    }
    at += sprintf(wanted + at, " >");
    HOLDS(length == (size_t)at && length <= TEXT_LONG_MAX && memcmp(text, wanted, length) == 0, "a long send is passed on whole");
}

static void check_words(const char *element)
{
    dahl_can_frame_t frame, other;
    int good = text_to_send(element, &frame);
    HOLDS(good == read_send(element, &other), "a send is accepted if and only if the second reader accepts it");
    HOLDS(!good || (is_same(&frame, &other) && frame.time_us == 0), "a send has the frame of the second reader");
    HOLDS(text_is_send(element) || !good, "a send is known by its first word");
    if (good && (frame.flags & DAHL_CAN_FRAME_CUT)) {
        check_long_send(element, &frame);
    }
    if (!good) {
        good = text_to_frame(element, &frame);
        HOLDS(good == read_frame(element, &other), "a frame is accepted if and only if the second reader accepts it");
        HOLDS(!good || (is_same(&frame, &other) && frame.time_us == other.time_us), "a frame is that of the second reader");
    }
    if (good) {
        HOLDS(is_frame(&frame), "an accepted frame is in range");
        check_written(&frame);
        frame.flags |= frame.data[0] & 1u ? DAHL_CAN_FRAME_REMOTE : DAHL_CAN_FRAME_ERROR;
        check_written(&frame);
    }
}

/* An element begins with <, ends with >, has no 0 and at most TEXT_ELEMENT_MAX characters. Each other piece counts as garbage. */
static void check_text(const uint8_t *data, size_t size)
{
    text_splitter_t splitter = {0};
    size_t begin = 0; /* of the element, after its <; 0: outside */
    uint64_t garbage = 0;
    for (size_t i = 0; i < size; i++) {
        int is_end = begin > 0 && data[i] == '>' && i - begin < TEXT_ELEMENT_MAX + 1u;
        int is_broken = begin > 0 && !is_end && (data[i] == '<' || data[i] == 0 || i - begin >= TEXT_ELEMENT_MAX);
        HOLDS(text_feed(&splitter, (char)data[i]) == is_end, "an element ends with > and with nothing else");
        if (is_end) {
            HOLDS(memcmp(splitter.element, data + begin, i - begin) == 0, "an element is the text between < and >");
            check_words(splitter.element);
        }
        garbage += is_broken || (begin == 0 && memchr("< \r\n", data[i], 4) == NULL);
        HOLDS(splitter.garbage == garbage, "each piece outside elements is counted");
        begin = data[i] == '<' ? i + 1 : is_end || is_broken ? 0 : begin;
    }
}

/* --- server ------------------------------------------------------------------------------------------------------- */

static socketcand_server_t server;
static text_splitter_t heard[PLAY_PEERS];

static void check_element(const char *element)
{
    static const char *const words[] = {" hi ", " ok ", " echo ", " error could not open bus ", " error unknown command "};
    dahl_can_frame_t frame;
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        if (strcmp(element, words[i]) == 0) {
            return;
        }
    }
    HOLDS(text_to_frame(element, &frame) && is_frame(&frame), "the server sends elements of the protocol only");
}

static void hear(void *context, int peer, const char *bytes, size_t count)
{
    (void)context;
    for (size_t i = 0; i < count; i++) {
        if (text_feed(&heard[peer], bytes[i])) {
            check_element(heard[peer].element);
        }
    }
    HOLDS(heard[peer].garbage == 0, "the server sends nothing between elements");
}

/* All but the outboxes, which are large. */
static void clear_server(void)
{
    memset(&server, 0, offsetof(socketcand_server_t, queue));
    server.queue.head = 0;
    server.queue.tail = 0;
    server.patience_ms = 0;
    server.report = NULL;
    for (size_t i = 0; i < SOCKETCAND_CLIENTS; i++) {
        memset(&server.clients[i], 0, offsetof(socketcand_client_t, outbox));
        server.clients[i].outbox.begin = 0;
        server.clients[i].outbox.end = 0;
    }
}

static void take_frames(dahl_can_bus_t *bus, uint32_t most)
{
    dahl_can_frame_t frame;
    dahl_can_result_t result = DAHL_CAN_BUS_OK;
    for (uint32_t i = 0; i < most && result == DAHL_CAN_BUS_OK; i++) {
        result = dahl_can_bus_receive(bus, &frame, 1000);
        HOLDS(result != DAHL_CAN_BUS_OK || is_frame(&frame), "a received frame is in range");
    }
}

static void send_frames(dahl_can_bus_t *bus, uint32_t count, fuzz_bytes_t *bytes)
{
    dahl_can_frame_t frame = {.id = fuzz_u8(bytes), .length = 8}, back;
    for (uint32_t i = 0; i < count; i++) {
        dahl_can_result_t result = dahl_can_bus_send(bus, &frame);
        HOLDS(result == DAHL_CAN_BUS_OK || result == DAHL_CAN_BUS_GONE, "there is room while frames are received");
        if (result != DAHL_CAN_BUS_OK) {
            return;
        }
        dahl_can_bus_receive(bus, &back, 0);
    }
}

static void say(play_peer_t *peer, fuzz_bytes_t *bytes)
{
    size_t count = fuzz_u8(bytes);
    count = count < bytes->left ? count : bytes->left;
    if (peer->says_left == 0) {
        peer->says = bytes->at;
        peer->says_left = count;
    }
    bytes->at += count;
    bytes->left -= count;
}

static void join(int i)
{
    play_peer_t *peer = &play.peers[i];
    if (!peer->is_connected && !peer->waits_at_door) {
        *peer = (play_peer_t){.waits_at_door = 1, .hears = hear};
        heard[i] = (text_splitter_t){0};
    }
}

/* Once: more frames than an outbox holds, for a client that does not read. */
static uint32_t flood(const play_peer_t *peer, int *floods, uint8_t size)
{
    return peer->is_connected && peer->is_deaf && (*floods)++ == 0 ? 4200u + 4u * size : 1u;
}

static void act(fuzz_bytes_t *bytes, int *floods)
{
    uint8_t what = fuzz_u8(bytes);
    int i = (what >> 4) % PLAY_PEERS;
    play_peer_t *peer = &play.peers[i];
    switch (what & 7) {
    case 0: join(i); break;
    case 1: say(peer, bytes); break;
    case 2: peer->has_hung_up = 1; break;
    case 3: peer->is_deaf = !peer->is_deaf; break;
    case 4: peer->takes = fuzz_u8(bytes); break;
    case 5: send_frames(&server.bus, what & 8 ? flood(peer, floods, fuzz_u8(bytes)) : 1, bytes); break;
    case 6: play.now_ns += fuzz_u8(bytes) * UINT64_C(1000000); break;
    default: peer->is_reset = what >> 7;
    }
    take_frames(&server.bus, 64);
}

static void check_server(const uint8_t *data, size_t size)
{
    fuzz_bytes_t bytes = {data, size};
    int floods = 0;
    clear_server();
    HOLDS(socketcand_serve(&server, 0, "vcan0", clock_of_play) == DAHL_CAN_BUS_OK, "the server listens");
    server.patience_ms = fuzz_u8(&bytes) & 1 ? 30 : 0;
    while (bytes.left > 0) {
        act(&bytes, &floods);
    }
    take_frames(&server.bus, 1024);
    server.bus.ops->close(&server.bus);
    HOLDS(play.open == 0, "every descriptor is closed once");
}

/* --- client ------------------------------------------------------------------------------------------------------- */

static void hear_client(void *context, int peer, const char *bytes, size_t count)
{
    (void)context;
    (void)peer;
    for (size_t i = 0; i < count; i++) {
        text_feed(&heard[0], bytes[i]);
    }
    HOLDS(heard[0].garbage == 0, "the client sends elements only");
}

static int greets(const uint8_t *data, size_t size)
{
    static const char *const words[] = {"< hi >", "< ok >", "< ok >"};
    for (size_t i = 0; i < 3; i++) {
        while (size > 0 && memchr(" \r\n", *data, 3) != NULL) {
            data++;
            size--;
        }
        if (size < 6 || memcmp(data, words[i], 6) != 0) {
            return 0;
        }
        data += 6;
        size -= 6;
    }
    return 1;
}

static void check_client(const uint8_t *data, size_t size)
{
    static socketcand_member_t member;
    memset(&member, 0, offsetof(socketcand_member_t, queue));
    member.queue.head = 0;
    member.queue.tail = 0;
    memset(&member.input, 0, sizeof member.input);
    member.outbox.begin = 0;
    member.outbox.end = 0;
    heard[0] = (text_splitter_t){0};
    play.peers[0] = (play_peer_t){.says = data, .says_left = size, .hears = hear_client};
    dahl_can_result_t result = socketcand_join(&member, "host", "1", "vcan0", clock_of_play);
    HOLDS((result == DAHL_CAN_BUS_OK) == greets(data, size), "the client joins if and only if the server greets");
    if (result == DAHL_CAN_BUS_OK) {
        dahl_can_frame_t frame = {.id = 0x123, .length = 2};
        dahl_can_bus_send(&member.bus, &frame);
        take_frames(&member.bus, 600);
        play.peers[0].has_hung_up = 1;
        take_frames(&member.bus, 600);
        member.bus.ops->close(&member.bus);
    }
    HOLDS(play.open == 0, "every descriptor is closed once");
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0) {
        return 0;
    }
    play = (play_t){.now_ns = 1};
    switch (data[0] % 3) {
    case 0: check_text(data + 1, size - 1); break;
    case 1: check_server(data + 1, size - 1); break;
    default: check_client(data + 1, size - 1);
    }
    return 0;
}

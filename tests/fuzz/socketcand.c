/* SPDX-License-Identifier: MIT */
/*
 * The socketcand protocol: its text against a second reader, the server with up to three clients that join, say anything
 * in any pieces, do not read, hang up; and the client with a server that says anything. Whatever they say, frames are
 * frames, and what goes out is elements of the protocol and nothing else.
 */
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
           (frame->flags & ~(DAHL_CAN_FRAME_EXTENDED | DAHL_CAN_FRAME_OWN | DAHL_CAN_FRAME_FD)) == 0;
}

static int is_same(const dahl_can_frame_t *a, const dahl_can_frame_t *b)
{
    return a->id == b->id && a->flags == b->flags && a->length == b->length && memcmp(a->data, b->data, a->length) == 0;
}

/* --- text --------------------------------------------------------------------------------------------------------- */

/* Words of an element, parted by spaces; -1: one is too long for this reader, which no good element has. */
static int words_of(const char *element, char words[68][32])
{
    int count = 0;
    for (size_t used = 0; *element != '\0'; element++) {
        used = *element == ' ' ? 0 : used + 1;
        if (used == 1 && ++count > 68) {
            return -1;
        }
        if (used >= 32) {
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

static int read_send(const char *element, dahl_can_frame_t *frame)
{
    char words[68][32];
    int count = words_of(element, words);
    *frame = (dahl_can_frame_t){0};
    if (count < 3 || strcmp(words[0], "send") != 0 || !read_id(words[1], frame)) {
        return 0;
    }
    uint8_t length, byte;
    int good = read_byte(words[2], 64, &length) && count == 3 + length && (length <= 8 || strchr("\14\20\24\30\40\60\100", length));
    for (int i = 0; good && i < length; i++) {
        good = read_byte(words[3 + i], 255, &byte);
        frame->data[i < 8 ? i : 7] = i < 8 ? byte : frame->data[7];
    }
    frame->length = length <= 8 ? length : 8;
    frame->flags |= length <= 8 ? 0 : DAHL_CAN_FRAME_FD;
    return good;
}

static void check_written(const dahl_can_frame_t *frame)
{
    char text[TEXT_FRAME_MAX + 1], element[TEXT_FRAME_MAX + 1];
    dahl_can_frame_t back;
    size_t length = text_from_frame(text, frame);
    if (frame->flags & DAHL_CAN_FRAME_FD) {
        LAW(length == 0 && text_from_send(text, frame) == 0, "CAN FD is not passed on");
        return;
    }
    LAW(length > 4 && length < TEXT_FRAME_MAX && text[0] == '<' && text[length - 1] == '>', "a frame becomes an element");
    memcpy(element, text + 1, length - 2);
    element[length - 2] = '\0';
    LAW(text_to_frame(element, &back) && is_same(&back, frame) && back.time_us == frame->time_us, "frame: written, read back");
    length = text_from_send(text, frame);
    LAW(length > 4 && length < TEXT_FRAME_MAX, "a send becomes an element");
    memcpy(element, text + 1, length - 2);
    element[length - 2] = '\0';
    LAW(text_to_send(element, &back) && is_same(&back, frame), "send: written, read back");
}

static void check_words(const char *element)
{
    dahl_can_frame_t frame, other;
    int good = text_to_send(element, &frame);
    LAW(good == read_send(element, &other), "a send is taken iff it is one");
    LAW(!good || is_same(&frame, &other), "the frame is what the words say");
    if (good || text_to_frame(element, &frame)) {
        LAW(is_frame(&frame), "what comes out is a frame");
        check_written(&frame);
    }
}

/* Elements begin with <, end with >, hold no 0 and are at most TEXT_ELEMENT_MAX long. */
static void check_text(const uint8_t *data, size_t size)
{
    text_splitter_t splitter = {0};
    size_t begin = 0; /* after the last < ; 0: none */
    for (size_t i = 0; i < size; i++) {
        int inside = begin > 0 && i - begin < TEXT_ELEMENT_MAX + (data[i] == '>' ? 1u : 0u);
        int whole = text_feed(&splitter, (char)data[i]);
        LAW(whole == (inside && data[i] == '>'), "an element ends with > and nothing else");
        if (whole) {
            LAW(memcmp(splitter.element, data + begin, i - begin) == 0, "an element is what stands between < and >");
            check_words(splitter.element);
        }
        begin = data[i] == '<' ? i + 1 : whole || !inside || data[i] == 0 ? 0 : begin;
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
    LAW(text_to_frame(element, &frame) && is_frame(&frame), "the server says elements of the protocol only");
}

static void hear(void *context, int peer, const char *bytes, size_t count)
{
    (void)context;
    for (size_t i = 0; i < count; i++) {
        if (text_feed(&heard[peer], bytes[i])) {
            check_element(heard[peer].element);
        }
    }
    LAW(heard[peer].garbage == 0, "the server says nothing between elements");
}

/* The outboxes are large, and need not be cleared. */
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
        LAW(result != DAHL_CAN_BUS_OK || is_frame(&frame), "what comes from a bus is a frame");
    }
}

static void send_frames(dahl_can_bus_t *bus, uint32_t count, fuzz_bytes_t *bytes)
{
    dahl_can_frame_t frame = {.id = fuzz_u8(bytes), .length = 8}, back;
    for (uint32_t i = 0; i < count; i++) {
        dahl_can_result_t result = dahl_can_bus_send(bus, &frame);
        LAW(result == DAHL_CAN_BUS_OK || result == DAHL_CAN_BUS_GONE, "there is room where frames are taken");
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

/* More than an outbox holds, once, for a client that does not read. */
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
    LAW(socketcand_serve(&server, 0, "vcan0", clock_of_play) == DAHL_CAN_BUS_OK, "the server listens");
    server.patience_ms = fuzz_u8(&bytes) & 1 ? 30 : 0;
    while (bytes.left > 0) {
        act(&bytes, &floods);
    }
    take_frames(&server.bus, 1024);
    server.bus.ops->close(&server.bus);
    LAW(play.open == 0, "every descriptor is closed once");
}

/* --- client ------------------------------------------------------------------------------------------------------- */

static void hear_client(void *context, int peer, const char *bytes, size_t count)
{
    (void)context;
    (void)peer;
    for (size_t i = 0; i < count; i++) {
        text_feed(&heard[0], bytes[i]);
    }
    LAW(heard[0].garbage == 0, "the client says elements only");
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
    LAW((result == DAHL_CAN_BUS_OK) == greets(data, size), "a server is one iff it says so");
    if (result == DAHL_CAN_BUS_OK) {
        dahl_can_frame_t frame = {.id = 0x123, .length = 2};
        dahl_can_bus_send(&member.bus, &frame);
        take_frames(&member.bus, 600);
        play.peers[0].has_hung_up = 1;
        take_frames(&member.bus, 600);
        member.bus.ops->close(&member.bus);
    }
    LAW(play.open == 0, "every descriptor is closed once");
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

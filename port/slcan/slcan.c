/* SPDX-License-Identifier: MIT */
/* A line is buffered, then read from left to right. The first error selects the error counter. */
#include "slcan.h"

#include <string.h>

#define CR '\r'
#define BEL "\a"

/* A line while it is read. error points to the counter of the first error; NULL: no error. */
typedef struct {
    const char *at;
    uint32_t left; /* characters from `at` on */
    slcan_counts_t *counts;
    uint32_t *error;
} reader_t;

static void fail(reader_t *reader, uint32_t *why)
{
    if (reader->error == NULL) {
        reader->error = why;
    }
}

static uint32_t read_digit(reader_t *reader)
{
    char c = *reader->at++;
    uint32_t number = (uint32_t)c - (uint32_t)'0', letter = (uint32_t)(c | 0x20) - (uint32_t)'a';
    reader->left--;
    if (number < 10u) {
        return number;
    }
    if (letter >= 6u) {
        fail(reader, &reader->counts->not_hex);
    }
    return letter + 10u;
}

/* After an error, reading continues, but the values are not used. */
static uint32_t read_hex(reader_t *reader, uint32_t digits)
{
    uint32_t value = 0;
    for (; digits > 0; digits--) {
        if (reader->left == 0u) {
            fail(reader, &reader->counts->cut);
        } else {
            value = 16u * value + read_digit(reader);
        }
    }
    return value;
}

static void read_id(reader_t *reader, dahl_can_frame_t *frame)
{
    bool is_extended = (frame->flags & DAHL_CAN_FRAME_EXTENDED) != 0;
    frame->id = read_hex(reader, is_extended ? 8u : 3u);
    if (frame->id > (is_extended ? 0x1FFFFFFFu : 0x7FFu)) {
        fail(reader, &reader->counts->wrong_length);
    }
}

/* Convert a length code to bytes. A classic frame has at most 8. */
static uint32_t read_length(reader_t *reader, const dahl_can_frame_t *frame)
{
    static const uint8_t fd_lengths[] = {12, 16, 20, 24, 32, 48, 64};
    uint32_t code = read_hex(reader, 1);
    if (code > 8u && !(frame->flags & DAHL_CAN_FRAME_FD)) {
        fail(reader, &reader->counts->wrong_length);
    }
    return code <= 8u || reader->error != NULL ? code : fd_lengths[code - 9u];
}

/* Only the first 8 bytes of a CAN FD frame are stored. */
static void read_data(reader_t *reader, dahl_can_frame_t *frame)
{
    uint32_t length = read_length(reader, frame);
    if (reader->error != NULL) {
        return;
    }
    frame->length = (uint8_t)(length <= 8u ? length : 8u);
    for (uint32_t i = 0; i < length && !(frame->flags & DAHL_CAN_FRAME_REMOTE); i++) {
        uint8_t byte = (uint8_t)read_hex(reader, 2);
        if (i < frame->length) {
            frame->data[i] = byte;
        }
    }
    if (reader->left > 0u) {
        fail(reader, &reader->counts->wrong_length);
    }
}

static slcan_event_t answer(char *text, const char *words)
{
    (void)strcpy(text, words);
    return SLCAN_ANSWER;
}

static slcan_event_t refuse(slcan_t *self, uint32_t *why, char *text)
{
    ++*why;
    self->refused = true;
    return answer(text, BEL);
}

static slcan_event_t read_frame(slcan_t *self, uint8_t flags, dahl_can_frame_t *frame, char *text)
{
    reader_t reader = {self->line + 1, self->length - 1u, &self->counts, NULL};
    dahl_can_frame_t read = {.flags = flags};
    read_id(&reader, &read);
    read_data(&reader, &read);
    if (!self->open) {
        fail(&reader, &self->counts.closed);
    }
    if (reader.error != NULL) {
        return refuse(self, reader.error, text);
    }
    *frame = read;
    (void)answer(text, "\r");
    return SLCAN_FRAME;
}

static slcan_event_t set_open(slcan_t *self, bool open, char *text)
{
    self->open = open;
    return answer(text, "\r");
}

static slcan_event_t report_flags(slcan_t *self, char *text)
{
    bool refused = self->refused;
    self->refused = false;
    return answer(text, refused ? "F80\r" : "F00\r");
}

/* Commands of one letter. A longer line is an unknown command. */
static slcan_event_t read_letter(slcan_t *self, char *text)
{
    switch (self->length == 1 ? self->line[0] : '\0') {
    case 'O':
    case 'L': return set_open(self, true, text);
    case 'C': return set_open(self, false, text);
    case 'F': return report_flags(self, text);
    case 'V': return answer(text, "V0101\r");
    case 'v': return answer(text, "v0101\r");
    case 'N': return answer(text, "NDAHL\r");
    default: return refuse(self, &self->counts.unknown, text);
    }
}

/* S and one decimal digit, or s and 1 to 8 hexadecimal digits. The rate is ignored. */
static slcan_event_t read_bit_rate(slcan_t *self, char *text)
{
    reader_t reader = {self->line + 1, self->length - 1u, &self->counts, NULL};
    const bool is_code = self->length == 2 && self->line[1] >= '0' && self->line[1] <= '9';
    if (self->line[0] == 'S' ? !is_code : self->length < 2 || self->length > 9) {
        return refuse(self, &self->counts.unknown, text);
    }
    (void)read_hex(&reader, reader.left);
    return reader.error != NULL ? refuse(self, reader.error, text) : answer(text, "\r");
}

static slcan_event_t read_line(slcan_t *self, dahl_can_frame_t *frame, char *text)
{
    if (self->length == 0) {
        return answer(text, "\r");
    }
    switch (self->line[0]) {
    case 't': return read_frame(self, 0, frame, text);
    case 'T': return read_frame(self, DAHL_CAN_FRAME_EXTENDED, frame, text);
    case 'r': return read_frame(self, DAHL_CAN_FRAME_REMOTE, frame, text);
    case 'R': return read_frame(self, DAHL_CAN_FRAME_EXTENDED | DAHL_CAN_FRAME_REMOTE, frame, text);
    case 'd':
    case 'b': return read_frame(self, DAHL_CAN_FRAME_FD, frame, text);
    case 'D':
    case 'B': return read_frame(self, DAHL_CAN_FRAME_FD | DAHL_CAN_FRAME_EXTENDED, frame, text);
    case 'S':
    case 's': return read_bit_rate(self, text);
    default: return read_letter(self, text);
    }
}

slcan_event_t slcan_take(slcan_t *self, uint8_t byte, dahl_can_frame_t *frame, char *text)
{
    if (byte == '\n') {
        return SLCAN_NOTHING;
    }
    if (byte != CR) {
        if (self->length < SLCAN_LINE_MAX) {
            self->line[self->length] = (char)byte;
        }
        self->length += self->length <= SLCAN_LINE_MAX;
        return SLCAN_NOTHING;
    }
    slcan_event_t event = self->length > SLCAN_LINE_MAX ? refuse(self, &self->counts.too_long, text)
                                                        : read_line(self, frame, text);
    self->length = 0;
    return event;
}

static char *write_hex(char *text, uint32_t value, uint32_t digits)
{
    while (digits-- > 0) {
        *text++ = "0123456789ABCDEF"[value >> (4 * digits) & 15u];
    }
    return text;
}

uint32_t slcan_write(const dahl_can_frame_t *frame, char *text)
{
    bool is_extended = (frame->flags & DAHL_CAN_FRAME_EXTENDED) != 0, is_remote = (frame->flags & DAHL_CAN_FRAME_REMOTE) != 0;
    uint32_t bytes = is_remote ? 0u : frame->length;
    char *end = text;
    if ((frame->flags & (DAHL_CAN_FRAME_FD | DAHL_CAN_FRAME_ERROR)) || frame->length > 8) {
        return 0;
    }
    *end++ = (is_remote ? "rR" : "tT")[is_extended];
    end = write_hex(end, frame->id, is_extended ? 8u : 3u);
    end = write_hex(end, frame->length, 1);
    for (uint32_t i = 0; i < bytes; i++) {
        end = write_hex(end, frame->data[i], 2);
    }
    *end++ = CR;
    *end = '\0';
    return (uint32_t)(end - text);
}

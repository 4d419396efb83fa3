/* SPDX-License-Identifier: MIT */
#include "text.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool skip_outside(text_splitter_t *s, char c)
{
    if (c == '<') {
        s->inside = true;
        s->length = 0;
    } else if (c != ' ' && c != '\n' && c != '\r') {
        s->garbage++;
    }
    return false;
}

static bool end_element(text_splitter_t *s)
{
    s->element[s->length] = '\0';
    s->inside = false;
    return true;
}

bool text_feed(text_splitter_t *s, char c)
{
    size_t room = TEXT_ELEMENT_MAX - s->length;
    if (!s->inside) {
        return skip_outside(s, c);
    }
    if (c == '>') {
        return end_element(s);
    }
    if (c == '<' || c == '\0' || room == 0) { /* a 0 would hide the text after it */
        s->garbage++;
        s->inside = c == '<';
        s->length = 0;
        return false;
    }
    s->element[s->length++] = c;
    return false;
}

bool text_word(const char **cursor, char *word, size_t size)
{
    const char *start = *cursor + strspn(*cursor, " ");
    size_t length = strcspn(start, " ");
    *cursor = start + length;
    if (length == 0 || length >= size) {
        return false;
    }
    memcpy(word, start, length);
    word[length] = '\0';
    return true;
}

static int id_digits(const dahl_can_frame_t *frame)
{
    return (frame->flags & DAHL_CAN_FRAME_EXTENDED) != 0 ? 8 : 3;
}

static bool is_expressible(const dahl_can_frame_t *frame)
{
    return (frame->flags & (DAHL_CAN_FRAME_REMOTE | DAHL_CAN_FRAME_ERROR | DAHL_CAN_FRAME_FD)) == 0;
}

static char *put_byte(char *out, uint8_t byte)
{
    static const char digits[] = "0123456789ABCDEF";
    out[0] = digits[byte >> 4];
    out[1] = digits[byte & 15];
    return out + 2;
}

/* Write the begin of a frame element, up to its data. */
static char *put_head(char *out, const dahl_can_frame_t *frame)
{
    uint32_t id = frame->id & 0x1FFFFFFFu;
    uint64_t time_us = frame->time_us;
    return out + snprintf(out, TEXT_FRAME_MAX, "< frame %0*" PRIX32 " %" PRIu64 ".%06" PRIu64 " ", id_digits(frame), id,
                          time_us / 1000000u, time_us % 1000000u);
}

static size_t end_text(char *at, const char *out)
{
    memcpy(at, " >", 2);
    return (size_t)(at + 2 - out);
}

size_t text_from_frame(char *out, const dahl_can_frame_t *frame)
{
    if (!is_expressible(frame)) {
        return 0;
    }
    char *at = put_head(out, frame);
    for (size_t i = 0, length = frame->length; i < length; i++) {
        at = put_byte(at, frame->data[i]);
    }
    return end_text(at, out);
}

size_t text_from_send(char *out, const dahl_can_frame_t *frame)
{
    if (!is_expressible(frame)) {
        return 0;
    }
    uint32_t id = frame->id & 0x1FFFFFFFu;
    char *at = out + snprintf(out, TEXT_FRAME_MAX, "< send %0*" PRIX32 " %X", id_digits(frame), id, frame->length & 0x0Fu);
    for (size_t i = 0, length = frame->length; i < length; i++) {
        *at++ = ' ';
        at = put_byte(at, frame->data[i]);
    }
    return end_text(at, out);
}

static bool to_number(const char *word, int base, uint64_t limit, uint64_t *value)
{
    size_t digits = strspn(word, base == 16 ? "0123456789abcdefABCDEF" : "0123456789");
    if (digits == 0 || word[digits] != '\0') {
        return false;
    }
    *value = strtoull(word, NULL, base); /* ULLONG_MAX if it is too large */
    return *value <= limit;
}

static bool read_hex_word(const char **cursor, uint64_t limit, uint64_t *value)
{
    char word[9];
    return text_word(cursor, word, sizeof word) && to_number(word, 16, limit, value);
}

static bool read_id_word(const char **cursor, dahl_can_frame_t *frame)
{
    char word[9];
    uint64_t id;
    if (!text_word(cursor, word, sizeof word)) {
        return false;
    }
    bool is_extended = strlen(word) > 7;
    if (!to_number(word, 16, is_extended ? 0x1FFFFFFFu : 0x7FFu, &id)) {
        return false;
    }
    frame->id = (uint32_t)id;
    frame->flags = is_extended ? DAHL_CAN_FRAME_EXTENDED : 0;
    return true;
}

static bool has_verb(const char **cursor, const char *verb)
{
    char word[sizeof "frame"];
    return text_word(cursor, word, sizeof word) && strcmp(word, verb) == 0;
}

bool text_is_send(const char *element)
{
    return has_verb(&element, "send");
}

static bool is_at_end(const char *cursor)
{
    return cursor[strspn(cursor, " ")] == '\0';
}

/* A frame of more than 8 bytes is CAN FD, which has these lengths. Only its first 8 bytes are stored. */
static bool set_length(dahl_can_frame_t *frame, uint64_t length)
{
    static const char fd_lengths[] = {12, 16, 20, 24, 32, 48, 64, 0};
    if (length <= 8) {
        frame->length = (uint8_t)length;
        return true;
    }
    frame->length = 8;
    frame->flags |= DAHL_CAN_FRAME_FD | DAHL_CAN_FRAME_CUT;
    return strchr(fd_lengths, (int)length) != NULL;
}

static void store_byte(dahl_can_frame_t *frame, uint64_t i, uint64_t byte)
{
    if (i < frame->length) {
        frame->data[i] = (uint8_t)byte;
    }
}

bool text_to_send(const char *element, dahl_can_frame_t *frame)
{
    uint64_t length;
    uint64_t byte;
    memset(frame, 0, sizeof *frame);
    if (!has_verb(&element, "send") || !read_id_word(&element, frame) || !read_hex_word(&element, 64, &length) ||
        !set_length(frame, length)) {
        return false;
    }
    for (uint64_t i = 0; i < length; i++) {
        if (!read_hex_word(&element, 0xFF, &byte)) {
            return false;
        }
        store_byte(frame, i, byte);
    }
    return is_at_end(element);
}

size_t text_from_long_send(char *out, const char *element, const dahl_can_frame_t *frame)
{
    char word[16];
    char *at = put_head(out, frame);
    uint64_t byte;
    for (int i = 0; i < 3; i++) { /* send, id, length */
        (void)text_word(&element, word, sizeof word);
    }
    while (read_hex_word(&element, 0xFF, &byte)) {
        at = put_byte(at, (uint8_t)byte);
    }
    return end_text(at, out);
}

static bool read_time(const char **cursor, dahl_can_frame_t *frame)
{
    char word[32];
    uint64_t seconds;
    uint64_t micros;
    if (!text_word(cursor, word, sizeof word)) {
        return false;
    }
    char *point = strchr(word, '.');
    if (point == NULL || strlen(point) != 7) {
        return false;
    }
    *point = '\0';
    if (!to_number(word, 10, UINT64_MAX / 2000000u, &seconds) || !to_number(point + 1, 10, UINT64_MAX, &micros)) {
        return false;
    }
    frame->time_us = seconds * 1000000u + micros;
    return true;
}

static bool read_data_words(const char **cursor, dahl_can_frame_t *frame)
{
    char word[2 * 64 + 1];
    if (is_at_end(*cursor)) {
        return true;
    }
    if (!text_word(cursor, word, sizeof word) || strlen(word) % 2 != 0 || !set_length(frame, strlen(word) / 2)) {
        return false;
    }
    for (size_t i = 0, length = strlen(word) / 2; i < length; i++) {
        char pair[] = {word[2 * i], word[2 * i + 1], '\0'};
        uint64_t value;
        if (!to_number(pair, 16, UINT8_MAX, &value)) {
            return false;
        }
        store_byte(frame, i, value);
    }
    return true;
}

bool text_to_frame(const char *element, dahl_can_frame_t *frame)
{
    memset(frame, 0, sizeof *frame);
    return has_verb(&element, "frame") && read_id_word(&element, frame) && read_time(&element, frame) &&
           read_data_words(&element, frame) && is_at_end(element);
}

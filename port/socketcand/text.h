/* SPDX-License-Identifier: MIT */
/*
 * text: convert frames to and from the text of the socketcand protocol. Elements are "< word word ... >". Text between elements
 * is garbage: it is skipped and counted. So is an element longer than TEXT_ELEMENT_MAX characters.
 *
 *   < send ID LENGTH B B B ... >       client to server; hexadecimal; an ID of 8 digits is extended
 *   < frame ID SECONDS.MICROS BBBB >   server to client
 *
 * The protocol does not mark CAN FD. A frame of more than 8 bytes must be CAN FD; a shorter one looks like a classic frame.
 */
#ifndef SOCKETCAND_TEXT_H
#define SOCKETCAND_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dahl_can_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SOCKETCAND_HANDSHAKE_MS 5000 /* from the connection to raw mode, on both sides */

#define TEXT_ELEMENT_MAX 220u
#define TEXT_FRAME_MAX 80u /* longest element of a frame */
#define TEXT_LONG_MAX 184u /* the same of CAN FD with 64 bytes */

/* All zeros: between elements. */
typedef struct {
    size_t length;
    bool inside;
    uint64_t garbage; /* characters outside elements, and invalid elements */
    char element[TEXT_ELEMENT_MAX + 1];
} text_splitter_t;

/* Feed one character. True: element holds the words of a complete element, without < and >. */
bool text_feed(text_splitter_t *s, char c);

/* Write the element of a frame. Returns its length, at most TEXT_FRAME_MAX, or 0 if the protocol cannot express the frame. */
size_t text_from_frame(char *out, const dahl_can_frame_t *frame);
size_t text_from_send(char *out, const dahl_can_frame_t *frame);

/* Write the frame element of a send with more than 8 bytes, whole; *frame is from text_to_send(), with its time. Returns its
 * length, at most TEXT_LONG_MAX. */
size_t text_from_long_send(char *out, const char *element, const dahl_can_frame_t *frame);

/* False: another element, or an invalid one; then *frame may be incomplete. A send has no time, so its time_us is 0. */
bool text_to_send(const char *element, dahl_can_frame_t *frame);
bool text_to_frame(const char *element, dahl_can_frame_t *frame);

/* Is the element's first word send? The other words are not checked. */
bool text_is_send(const char *element);

/* Copy the next word of *cursor to word (size bytes). False: no word is left, or it is too long. */
bool text_word(const char **cursor, char *word, size_t size);

#ifdef __cplusplus
}
#endif

#endif

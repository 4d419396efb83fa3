/* SPDX-License-Identifier: MIT */
/*
 * text: the socketcand protocol as text, both ways. Elements are "< word word ... >"; anything between them is garbage,
 * counted and skipped, and so is an element that does not end within TEXT_ELEMENT_MAX characters.
 *
 *   < send ID LENGTH B B B ... >       client to server; hexadecimal; ID of 8 digits: extended
 *   < frame ID SECONDS.MICROS BBBB >   server to client
 *
 * The protocol does not say what is CAN FD. More than 8 bytes can be nothing else; a shorter frame of CAN FD looks like a
 * classic one.
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
#define TEXT_FRAME_MAX 80u /* longest element that a frame becomes */

/* All zeros: between elements. */
typedef struct {
    size_t length;
    bool inside;
    uint64_t garbage; /* pieces of input that belong to no element, and elements too long */
    char element[TEXT_ELEMENT_MAX + 1];
} text_splitter_t;

/* Feed one character. True: element holds the words of a complete element, without < and >. */
bool text_feed(text_splitter_t *s, char c);

/* Length of the text written to out, at most TEXT_FRAME_MAX; 0: the protocol has no words for such a frame. */
size_t text_from_frame(char *out, const dahl_can_frame_t *frame);
size_t text_from_send(char *out, const dahl_can_frame_t *frame);

/* False: not such an element, or not a good one; *frame may be half written. A send has no time: time_us stays 0. */
bool text_to_send(const char *element, dahl_can_frame_t *frame);
bool text_to_frame(const char *element, dahl_can_frame_t *frame);

/* The element's first word is send, whatever follows. */
bool text_is_send(const char *element);

/* The next word of *cursor into word (size bytes); false: none left or too long. */
bool text_word(const char **cursor, char *word, size_t size);

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
/*
 * slcan: CAN frames as text lines over a serial port, the protocol of the CAN232 adapters, from the adapter's side. To
 * python-can (-i slcan), slcand and most tools, a firmware with slcan is a CAN bus, and its node is the other member.
 *
 *   line from the host            answer       meaning
 *   O, L                          CR           open; frames pass from now on
 *   C                             CR           close
 *   S0 .. S9, s and 1 .. 8 hex    CR           bit rate: accepted and ignored, as a serial port has no bit timing
 *   tIIILDD..  TIIIIIIIILDD..     CR           a frame for the node, 11 or 29 bits of id, L bytes
 *   rIIIL      RIIIIIIIIL         CR           the same, remote
 *   d, D, b, B                    CR           CAN FD, as t and T; a node counts each as a wrong form
 *   V, v, N                       V0101, ..    version, serial number
 *   F                             Fxx          80 if a line was refused since the last F, else 00
 *   an empty line                 CR           (some hosts send it to clear the line buffer)
 *   any other line                BEL          refused and counted by reason, see slcan_counts_t
 *
 * A line ends with CR; LF is ignored. After O, the node's frames are sent to the host as t, T, r or R lines.
 * Each byte causes at most one event. There is no wait, no heap and no clock; the line buffer is the state.
 */
#ifndef SLCAN_H
#define SLCAN_H

#include <stdbool.h>
#include <stdint.h>

#include "dahl_can_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SLCAN_LINE_MAX 138u /* D, 8 digits, length, 128 digits */
#define SLCAN_TEXT_MAX 28u  /* of a frame of the node: T, 8 digits, length, 16 digits, CR, 0 */

/* Refused lines, by reason. */
typedef struct {
    uint32_t too_long;     /* more than SLCAN_LINE_MAX characters */
    uint32_t cut;          /* the line ends within id, length or data */
    uint32_t not_hex;      /* a character that must be a hexadecimal digit is not, also in a bit rate */
    uint32_t wrong_length; /* more than 8 bytes (CAN FD: 64), more data than its length, or an id out of range */
    uint32_t unknown;      /* a command that is not in the table above */
    uint32_t closed;       /* a frame before O */
} slcan_counts_t;

/* All zeros: closed, with an empty line. */
typedef struct {
    slcan_counts_t counts;
    uint32_t length; /* characters in line; above SLCAN_LINE_MAX: too long, skipped up to CR */
    bool open;
    bool refused; /* a line since the last F */
    char line[SLCAN_LINE_MAX];
} slcan_t;

typedef enum {
    SLCAN_NOTHING = 0, /* the line is incomplete */
    SLCAN_ANSWER = 1,  /* send *text */
    SLCAN_FRAME = 2    /* send *text; *frame is for the node */
} slcan_event_t;

/* Process one byte from the host. text has room for SLCAN_TEXT_MAX bytes; an answer is a string of 1 to 6 characters. */
slcan_event_t slcan_take(slcan_t *self, uint8_t byte, dahl_can_frame_t *frame, char *text);

/* Write a frame as a line with CR and a final 0. Returns its length, or 0 if slcan has no line for it (FD, error frame). */
uint32_t slcan_write(const dahl_can_frame_t *frame, char *text);

#ifdef __cplusplus
}
#endif

#endif

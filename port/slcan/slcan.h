/* SPDX-License-Identifier: MIT */
/*
 * slcan: CAN frames as text lines over a serial port, as the CAN232 adapters began it, from the adapter's side. A firmware
 * that speaks it is a CAN bus for python-can (-i slcan), slcand and most tools; its node is the other member of that bus.
 *
 *   line from the host            answer       meaning
 *   O, L                          CR           open; frames pass from now on
 *   C                             CR           close
 *   S0 .. S8, s and digits        CR           bit rate: taken and ignored, there is no bit timing here
 *   tIIILDD..  TIIIIIIIILDD..     CR           a frame for the node, 11 or 29 bits of id, L bytes
 *   rIIIL      RIIIIIIIIL         CR           the same, remote
 *   d, D, b, B                    CR           CAN FD, as t and T: a node counts it as a wrong form, whatever it holds
 *   V, v, N                       V0101, ..    version, serial number
 *   F                             Fxx          80 if a line was refused since the last F, else 00
 *   an empty line                 CR           (hosts send some to clear the way)
 *   all else                      BEL          refused and counted by why, see slcan_counts_t
 *
 * A line ends with CR; LF is ignored. Frames of the node come to the host as t, T, r or R lines, once open.
 * One byte in, at most one event out: no wait, no heap, no time. The line buffer is the state.
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

/* Why lines were refused. */
typedef struct {
    uint32_t too_long;     /* more characters than any line has */
    uint32_t cut;          /* ended within its id, length or data */
    uint32_t not_hex;      /* another character where a hexadecimal digit must be */
    uint32_t wrong_length; /* more than 8 bytes (in CAN FD 64), more data than it said, or an id out of range */
    uint32_t unknown;      /* a command that is none of those above */
    uint32_t closed;       /* a frame before O */
} slcan_counts_t;

/* All zeros: closed, nothing read yet. */
typedef struct {
    slcan_counts_t counts;
    uint32_t length; /* characters in line; above SLCAN_LINE_MAX: too long, waiting for its end */
    bool open;
    bool refused; /* since the last F */
    char line[SLCAN_LINE_MAX];
} slcan_t;

typedef enum {
    SLCAN_NOTHING = 0, /* the line goes on */
    SLCAN_ANSWER = 1,  /* send *text */
    SLCAN_FRAME = 2    /* send *text; *frame is for the node */
} slcan_event_t;

/* One byte from the host. text has SLCAN_TEXT_MAX bytes and is a string of 1 to 6 characters after an answer. */
slcan_event_t slcan_take(slcan_t *self, uint8_t byte, dahl_can_frame_t *frame, char *text);

/* A frame as a line with its CR and a final 0. Returns its length; 0 where a line cannot carry it (FD, error frame). */
uint32_t slcan_write(const dahl_can_frame_t *frame, char *text);

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
/* An absolute encoder on SPI. Its frame, most significant bit first: 16 bits of position, 6 zeros, error and warning (each 1 if
 * all is well), and the inverted CRC-8 (polynomial 0x97) of these 24 bits. A line that is stuck at 0 or 1 fails the CRC. */
#ifndef ENCODER_H
#define ENCODER_H

#include <stdbool.h>
#include <stdint.h>

enum { ENCODER_COUNTS = 65536, ENCODER_MAX_STEP = 1000 /* counts in a tick: 96 rad/s */ };

/* All zeros: no reading yet. */
typedef struct {
    int32_t count;                   /* of the last good reading, with whole turns; the first one is -32768 .. 32767 */
    uint32_t good_ticks, bad_ticks;  /* good or bad readings in a row; one of them is 0 */
    uint32_t corrupt, invalid, jumps; /* bad readings: wrong CRC; marked by the encoder; too far away */
    bool is_primed;                  /* a good reading has come */
} encoder_t;

/* Take the frame of a tick. Return the counts since the last good reading, 0 if this one is bad. */
int32_t encoder_take(encoder_t *encoder, const uint8_t frame[4]);

#endif

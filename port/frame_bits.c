/* SPDX-License-Identifier: MIT */
#include "frame_bits.h"

#include <stdbool.h>

enum { CRC_POLYNOMIAL = 0x4599, TAIL_BITS = 13, STUFF_RUN = 5 }; /* tail: delimiters, ACK, end of frame, 3 bits intermission */

typedef struct {
    uint32_t count; /* bits so far */
    uint32_t run;   /* consecutive equal bits */
    uint32_t last;
    uint32_t crc;
} bits_t;

static void put_bit(bits_t *bits, uint32_t bit)
{
    bool is_inverted = (bit ^ (bits->crc >> 14)) != 0;
    bits->crc = (bits->crc << 1) & 0x7FFFu;
    bits->crc ^= is_inverted ? (uint32_t)CRC_POLYNOMIAL : 0u;
    bits->run = bits->count > 0 && bit == bits->last ? bits->run + 1 : 1;
    bits->last = bit;
    bits->count++;
    if (bits->run == STUFF_RUN) { /* add a stuff bit of the other value */
        bits->last = 1 - bit;
        bits->run = 1;
        bits->count++;
    }
}

static void put_bits(bits_t *bits, uint32_t value, uint32_t width)
{
    while (width-- > 0) {
        put_bit(bits, (value >> width) & 1u);
    }
}

static void put_header(bits_t *bits, const dahl_can_frame_t *frame)
{
    uint32_t remote = (frame->flags & DAHL_CAN_FRAME_REMOTE) != 0 ? 1u : 0u;
    put_bits(bits, 0, 1);
    if ((frame->flags & DAHL_CAN_FRAME_EXTENDED) != 0) {
        put_bits(bits, frame->id >> 18, 11);
        put_bits(bits, 3, 2);
        put_bits(bits, frame->id & 0x3FFFFu, 18);
        put_bits(bits, remote << 2, 3);
    } else {
        put_bits(bits, frame->id, 11);
        put_bits(bits, remote << 2, 3);
    }
    put_bits(bits, frame->length, 4);
}

uint32_t can_frame_bits(const dahl_can_frame_t *frame)
{
    bits_t bits = {0};
    put_header(&bits, frame);
    for (uint32_t i = 0; i < frame->length && (frame->flags & DAHL_CAN_FRAME_REMOTE) == 0; i++) {
        put_bits(&bits, frame->data[i], 8);
    }
    put_bits(&bits, bits.crc, 15);
    return bits.count + TAIL_BITS;
}

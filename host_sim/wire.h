/* SPDX-License-Identifier: MIT */
/*
 * wire: a CAN bus in this process that takes time. A frame takes its own number of bits, stuff bits included; of those
 * that wait when the bus falls silent the lowest id goes first; equal ids keep their order.
 * Error frames, acknowledgement and retransmission are not modelled.
 */
#ifndef WIRE_H
#define WIRE_H

#include <stddef.h>

#include "can_bus.h"

#define WIRE_ROOM 256u /* frames that can wait; more are dropped and counted */

typedef struct {
    can_frame_t frame;
    uint64_t asked_ns;
} wire_frame_t;

typedef struct {
    can_bus_t bus; /* first: what the seam points to */
    uint32_t bitrate;
    uint64_t free_ns; /* when the last frame ended */
    size_t count;
    wire_frame_t waiting[WIRE_ROOM]; /* in the order of sending */
} wire_t;

/* Bits that a frame occupies a bus for: with stuff bits, end of frame and the pause after it. 111 to 135 for 8 bytes. */
uint32_t wire_bits(const can_frame_t *frame);

void wire_open(wire_t *self, uint32_t bitrate, can_clock_t clock);

#endif

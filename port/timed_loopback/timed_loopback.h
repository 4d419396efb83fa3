/* SPDX-License-Identifier: MIT */
/*
 * timed_loopback: a bus inside one process on which frames take time. A frame takes its own number of bits, stuff bits
 * included; of those that wait when the bus falls silent the lowest id goes first; equal ids keep their order.
 * Error frames, acknowledgement and retransmission are not modelled.
 */
#ifndef TIMED_LOOPBACK_H
#define TIMED_LOOPBACK_H

#include <stddef.h>

#include "dahl_can_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TIMED_LOOPBACK_ROOM 256u /* frames that can wait; more are dropped and counted */

typedef struct {
    dahl_can_frame_t frame;
    uint64_t asked_ns;
} timed_frame_t;

typedef struct {
    dahl_can_bus_t bus; /* first: what the seam points to */
    uint32_t bitrate;
    uint64_t free_ns; /* when the last frame ended */
    size_t count;
    timed_frame_t waiting[TIMED_LOOPBACK_ROOM]; /* in the order of sending */
} timed_loopback_t;

void timed_loopback_open(timed_loopback_t *self, uint32_t bitrate, dahl_can_clock_t clock);

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
/*
 * loopback: a bus inside one process, for virtual time and tests. If no frame arrives, receive() waits by the clock.
 *
 * Without a bit rate, each frame arrives at once and in the order of sending. With a bit rate, each frame occupies the bus for
 * its bits, stuff bits included. When the bus is free, the waiting frame with the lowest id starts; equal ids keep their order.
 * Error frames, acknowledgement and retransmission are not modelled.
 */
#ifndef LOOPBACK_H
#define LOOPBACK_H

#include <stddef.h>

#include "dahl_can_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LOOPBACK_ROOM 1024u      /* frames that can wait; more are dropped and counted */
#define LOOPBACK_TIMED_ROOM 256u /* the same with a bit rate: a queue that grows delays each frame with a higher id */

typedef struct {
    dahl_can_frame_t frame;
    uint64_t sent_ns;
} loopback_frame_t;

typedef struct {
    dahl_can_bus_t bus; /* first, so that a dahl_can_bus_t * is a loopback_t * */
    uint32_t bitrate;   /* bit/s; 0: frames occupy no time */
    uint64_t free_ns;   /* end of the last frame */
    size_t room;
    size_t count;
    loopback_frame_t waiting[LOOPBACK_ROOM]; /* in the order of sending */
} loopback_t;

/* With a bit rate the clock must have wait_us. */
void loopback_open(loopback_t *self, uint32_t bitrate, dahl_can_clock_t clock);

#ifdef __cplusplus
}
#endif

#endif

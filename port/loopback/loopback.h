/* SPDX-License-Identifier: MIT */
/* loopback: a bus inside one process, for virtual time and tests. With no frame, receive() waits by the clock. */
#ifndef LOOPBACK_H
#define LOOPBACK_H

#include "dahl_can_bus.h"
#include "../frame_queue.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    dahl_can_bus_t bus; /* first, so that a dahl_can_bus_t * is a loopback_t * */
    frame_queue_t queue;
} loopback_t;

void loopback_open(loopback_t *self, dahl_can_clock_t clock);

#ifdef __cplusplus
}
#endif

#endif

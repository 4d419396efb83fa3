/* SPDX-License-Identifier: MIT */
/*
 * loopback: a bus inside one process, for virtual time and tests. Each frame arrives at once and in the order of sending. If no
 * frame arrives, receive() waits by the clock.
 */
#ifndef LOOPBACK_H
#define LOOPBACK_H

#include <stddef.h>

#include "dahl_can_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LOOPBACK_ROOM 1024u /* frames that can wait; more are dropped and counted */

typedef struct {
    dahl_can_bus_t bus; /* first, so that a dahl_can_bus_t * is a loopback_t * */
    size_t count;
    dahl_can_frame_t waiting[LOOPBACK_ROOM]; /* in the order of sending */
} loopback_t;

void loopback_open(loopback_t *self, dahl_can_clock_t clock);

#ifdef __cplusplus
}
#endif

#endif

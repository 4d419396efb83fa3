/* SPDX-License-Identifier: MIT */
/*
 * socketcan: a bus of the Linux kernel (vcan0, can0). Frames carry the kernel's time stamps. One raw socket that also
 * receives its own frames, so that even two parts in one process talk through the kernel.
 */
#ifndef SOCKETCAN_H
#define SOCKETCAN_H

#include <stddef.h>

#include "dahl_can_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    dahl_can_bus_t bus; /* first */
    int fd;
} socketcan_t;

/* DAHL_CAN_BUS_ERROR: no such interface, or the kernel has no CAN; errno says why. */
dahl_can_result_t socketcan_open(socketcan_t *self, const char *interface, dahl_can_clock_t clock);

/* Let the kernel pass only frames whose low 11 bits are one of these ids (extended ones too), and error frames. */
dahl_can_result_t socketcan_filter(socketcan_t *self, const uint32_t *ids, size_t count);

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
/*
 * socketcan: a bus of the Linux kernel (vcan0, can0). Frames have the kernel's time stamps. The raw socket also receives its
 * own frames, so that an encoder and a node in one process also communicate through the kernel.
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

/* DAHL_CAN_BUS_ERROR: the interface does not exist, or the kernel has no CAN. errno is set. */
dahl_can_result_t socketcan_open(socketcan_t *self, const char *interface, dahl_can_clock_t clock);

/* Let the kernel pass only error frames and frames whose low 11 bits are one of these ids, also with an extended id. */
dahl_can_result_t socketcan_filter(socketcan_t *self, const uint32_t *ids, size_t count);

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
/*
 * serial_bus: implement dahl_can_bus.h over a serial port with slcan, for the node in a firmware. receive() also sends the
 * answers to the host. Unlike on other buses, own frames do not come back.
 */
#ifndef SERIAL_BUS_H
#define SERIAL_BUS_H

#include "slcan.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    bool (*read)(uint8_t *byte);  /* false: no byte has arrived */
    void (*write)(uint8_t byte); /* waits for room */
} serial_port_t;

typedef struct {
    dahl_can_bus_t bus; /* first, so that a dahl_can_bus_t * is a serial_bus_t * */
    serial_port_t port;
    slcan_t slcan;
} serial_bus_t;

void serial_bus_open(serial_bus_t *self, serial_port_t port, dahl_can_clock_t clock);

#ifdef __cplusplus
}
#endif

#endif

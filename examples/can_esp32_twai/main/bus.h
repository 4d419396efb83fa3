/* SPDX-License-Identifier: MIT */
/* The TWAI controller of an ESP32 at 500 kbit/s. bus_5_0.c implements it by driver/twai.h of ESP-IDF 5.0 to 5.4, bus_5_5.c by
 * esp_twai.h of ESP-IDF 5.5 to 6.1. Call all of it from one task. */
#ifndef BUS_H
#define BUS_H

#include <stdbool.h>
#include <dahl_can_bus.h>

#define BUS_TX_PIN 5
#define BUS_RX_PIN 4
#define BUS_WAIT_TICKS 1 /* of FreeRTOS */
#define BUS_QUEUE 5      /* frames, in each direction */

/* Start the controller. It passes frames whose id has the bits of `id` where `mask` is 1. Returns 0 or the code of the driver. */
int bus_start(uint32_t id, uint32_t mask);

/* Wait at most BUS_WAIT_TICKS for a frame. */
bool bus_receive(dahl_can_frame_t *frame);

/* Queue a frame. Returns false if the queue is full or the bus is off. */
bool bus_send(const dahl_can_frame_t *frame);

/* Return true once after each bus-off. The call drops the frames that wait to be sent, and starts the recovery. */
bool bus_went_off(void);

/* Return false from bus-off until the recovery ends, after 128 times 11 recessive bits. */
bool bus_is_on(void);

#endif

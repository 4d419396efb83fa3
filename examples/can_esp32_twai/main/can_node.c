/* SPDX-License-Identifier: MIT */
/* The friction node on the TWAI controller of an ESP32 at 500 kbit/s, for ESP-IDF 5.0 to 6.1. It was not run on hardware.
 * Interrupts of the driver queue frames and one task serves them, so that no mask is needed. */
#include <dahl_node.h>
#include <esp_timer.h>
#include "bus.h"
#include "can_node.h"

#define ID (DAHL_FRAMES_ID_ENCODER | 0u) /* of node 0 */
#define ID_MASK 0x70Fu                   /* passes 0x100, 0x110 .. 0x170; the node ignores those it does not use */

static const dahl_params_t params = {100.0f, 0.5f, 6.2831853f / 16384}; /* sigma0 N m/rad, Fc N m, rad/count */
static dahl_node_t node;
volatile uint32_t can_dropped;

int can_node_init(void)
{
    int code = dahl_node_init(&node, &params, ID & 15);
    return code != DAHL_OK ? code : bus_start(ID, ID_MASK);
}

static uint32_t clock_us(void)
{
    return (uint32_t)esp_timer_get_time();
}

static void send(const dahl_can_frame_t *frame)
{
    can_dropped += !bus_send(frame);
}

void can_node_serve(void)
{
    dahl_can_frame_t in, out;
    if (bus_receive(&in) && dahl_node_receive(&node, &in, clock_us(), &out)) {
        send(&out);
    }
    if (bus_went_off()) {
        dahl_node_bus_off(&node, clock_us());
    }
    if (bus_is_on() && dahl_node_tick(&node, clock_us(), &out)) {
        send(&out);
    }
}

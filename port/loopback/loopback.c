/* SPDX-License-Identifier: MIT */
/* loopback: see loopback.h. */
#include "loopback.h"

#include <stddef.h>

static dahl_can_result_t loopback_send(dahl_can_bus_t *bus, const dahl_can_frame_t *frame)
{
    loopback_t *self = (loopback_t *)bus;
    dahl_can_frame_t stamped = *frame;
    stamped.time_us = dahl_can_clock_now_us(&bus->clock);
    stamped.flags |= DAHL_CAN_FRAME_OWN;
    if (!frame_queue_put(&self->queue, &stamped)) {
        bus->counts.dropped++;
        return DAHL_CAN_BUS_BUSY;
    }
    return DAHL_CAN_BUS_OK;
}

static dahl_can_result_t loopback_receive(dahl_can_bus_t *bus, dahl_can_frame_t *frame, uint32_t timeout_us)
{
    loopback_t *self = (loopback_t *)bus;
    if (frame_queue_take(&self->queue, frame)) {
        return DAHL_CAN_BUS_OK;
    }
    if (timeout_us > 0 && bus->clock.wait_us != NULL) {
        bus->clock.wait_us(bus->clock.context, timeout_us); /* nobody else can send meanwhile */
    }
    return DAHL_CAN_BUS_NONE;
}

static uint32_t loopback_peers(const dahl_can_bus_t *bus)
{
    (void)bus;
    return 0;
}

static void loopback_close(dahl_can_bus_t *bus)
{
    (void)bus;
}

static const dahl_can_bus_ops_t loopback_ops = {loopback_send, loopback_receive, loopback_peers, loopback_close};

void loopback_open(loopback_t *self, dahl_can_clock_t clock)
{
    self->bus = (dahl_can_bus_t){.ops = &loopback_ops, .clock = clock};
    self->queue.head = 0;
    self->queue.tail = 0;
}

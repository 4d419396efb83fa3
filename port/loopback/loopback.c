/* SPDX-License-Identifier: MIT */
#include "loopback.h"

#include <string.h>

static loopback_t *self_of(dahl_can_bus_t *bus)
{
    return (loopback_t *)(void *)bus;
}

static dahl_can_result_t loopback_send(dahl_can_bus_t *bus, const dahl_can_frame_t *frame)
{
    loopback_t *self = self_of(bus);
    if (self->count == LOOPBACK_ROOM) {
        bus->counts.dropped++;
        return DAHL_CAN_BUS_BUSY;
    }
    dahl_can_frame_t *last = &self->waiting[self->count++];
    *last = *frame;
    last->flags |= DAHL_CAN_FRAME_OWN;
    last->time_us = dahl_can_clock_now_us(&bus->clock);
    return DAHL_CAN_BUS_OK;
}

static dahl_can_result_t loopback_receive(dahl_can_bus_t *bus, dahl_can_frame_t *frame, uint32_t timeout_us)
{
    loopback_t *self = self_of(bus);
    if (self->count == 0) {
        if (timeout_us > 0 && bus->clock.wait_us != NULL) {
            bus->clock.wait_us(bus->clock.context, timeout_us);
        }
        return DAHL_CAN_BUS_NONE;
    }
    *frame = self->waiting[0];
    self->count--;
    memmove(&self->waiting[0], &self->waiting[1], self->count * sizeof self->waiting[0]);
    return DAHL_CAN_BUS_OK;
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

void loopback_open(loopback_t *self, dahl_can_clock_t clock)
{
    static const dahl_can_bus_ops_t ops = {loopback_send, loopback_receive, loopback_peers, loopback_close};
    self->bus = (dahl_can_bus_t){.ops = &ops, .clock = clock};
    self->count = 0;
}

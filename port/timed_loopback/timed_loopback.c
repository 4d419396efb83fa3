/* SPDX-License-Identifier: MIT */
/* timed_loopback: see timed_loopback.h. */
#include "timed_loopback.h"

#include <string.h>

#include "../frame_bits.h"

static timed_loopback_t *self_of(dahl_can_bus_t *bus)
{
    return (timed_loopback_t *)(void *)bus;
}

static uint64_t now_ns(const timed_loopback_t *self)
{
    return self->bus.clock.now_ns(self->bus.clock.context);
}

static dahl_can_result_t timed_send(dahl_can_bus_t *bus, const dahl_can_frame_t *frame)
{
    timed_loopback_t *self = self_of(bus);
    if (self->count == TIMED_LOOPBACK_ROOM) {
        bus->counts.dropped++;
        return DAHL_CAN_BUS_BUSY;
    }
    self->waiting[self->count] = (timed_frame_t){*frame, now_ns(self)};
    self->waiting[self->count++].frame.flags |= DAHL_CAN_FRAME_OWN;
    return DAHL_CAN_BUS_OK;
}

/* What goes first on the bus has the smaller number. */
static uint64_t priority(const dahl_can_frame_t *frame)
{
    if ((frame->flags & DAHL_CAN_FRAME_EXTENDED) != 0) {
        return (uint64_t)(frame->id >> 18) << 19 | 1u << 18 | (frame->id & 0x3FFFFu);
    }
    return (uint64_t)frame->id << 19;
}

/* The frame that wins the bus as soon as it is free; *start_ns: when. There is one. */
static size_t winner(const timed_loopback_t *self, uint64_t *start_ns)
{
    size_t best = 0;
    *start_ns = self->waiting[0].asked_ns > self->free_ns ? self->waiting[0].asked_ns : self->free_ns;
    for (size_t i = 1; i < self->count; i++) {
        const timed_frame_t *waiting = &self->waiting[i];
        if (waiting->asked_ns <= *start_ns && priority(&waiting->frame) < priority(&self->waiting[best].frame)) {
            best = i;
        }
    }
    return best;
}

static void take(timed_loopback_t *self, size_t i, dahl_can_frame_t *frame)
{
    *frame = self->waiting[i].frame;
    frame->time_us = dahl_can_clock_now_us(&self->bus.clock);
    self->count--;
    memmove(&self->waiting[i], &self->waiting[i + 1], (self->count - i) * sizeof self->waiting[0]);
}

static void wait_until(const timed_loopback_t *self, uint64_t when_ns)
{
    uint64_t now = now_ns(self);
    if (when_ns > now) {
        self->bus.clock.wait_us(self->bus.clock.context, (uint32_t)((when_ns - now + 999) / 1000));
    }
}

static dahl_can_result_t timed_receive(dahl_can_bus_t *bus, dahl_can_frame_t *frame, uint32_t timeout_us)
{
    timed_loopback_t *self = self_of(bus);
    uint64_t limit = now_ns(self) + (uint64_t)timeout_us * 1000u;
    uint64_t start;
    if (self->count > 0) {
        size_t first = winner(self, &start);
        uint64_t end = start + can_frame_bits(&self->waiting[first].frame) * UINT64_C(1000000000) / self->bitrate;
        if (end <= limit) {
            wait_until(self, end);
            self->free_ns = end;
            take(self, first, frame);
            return DAHL_CAN_BUS_OK;
        }
    }
    wait_until(self, limit);
    return DAHL_CAN_BUS_NONE;
}

static uint32_t timed_peers(const dahl_can_bus_t *bus)
{
    (void)bus;
    return 0;
}

static void timed_close(dahl_can_bus_t *bus)
{
    (void)bus;
}

void timed_loopback_open(timed_loopback_t *self, uint32_t bitrate, dahl_can_clock_t clock)
{
    static const dahl_can_bus_ops_t ops = {timed_send, timed_receive, timed_peers, timed_close};
    *self = (timed_loopback_t){.bus = {.ops = &ops, .clock = clock}, .bitrate = bitrate};
}

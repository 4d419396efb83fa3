/* SPDX-License-Identifier: MIT */
#include "loopback.h"

#include <string.h>

#include "../frame_bits.h"

#define NS_PER_US UINT64_C(1000)
#define NS_PER_S UINT64_C(1000000000)

static loopback_t *self_of(dahl_can_bus_t *bus)
{
    return (loopback_t *)(void *)bus;
}

static uint64_t now_ns(const loopback_t *self)
{
    return self->bus.clock.now_ns(self->bus.clock.context);
}

static dahl_can_result_t loopback_send(dahl_can_bus_t *bus, const dahl_can_frame_t *frame)
{
    loopback_t *self = self_of(bus);
    if (self->count == self->room) {
        bus->counts.dropped++;
        return DAHL_CAN_BUS_BUSY;
    }
    loopback_frame_t *last = &self->waiting[self->count++];
    *last = (loopback_frame_t){*frame, now_ns(self)};
    last->frame.flags |= DAHL_CAN_FRAME_OWN;
    return DAHL_CAN_BUS_OK;
}

/* Arbitration: the frame with the smaller number wins. */
static uint64_t priority(const dahl_can_frame_t *frame)
{
    if ((frame->flags & DAHL_CAN_FRAME_EXTENDED) != 0) {
        return (uint64_t)(frame->id >> 18) << 19 | 1u << 18 | (frame->id & 0x3FFFFu);
    }
    return (uint64_t)frame->id << 19;
}

/* The frame that wins the bus when it is free, and the time at which it starts. At least one frame must wait. */
static size_t arbitrate(const loopback_t *self, uint64_t *start_ns)
{
    size_t best = 0;
    *start_ns = self->waiting[0].sent_ns > self->free_ns ? self->waiting[0].sent_ns : self->free_ns;
    for (size_t i = 1; i < self->count; i++) {
        const loopback_frame_t *waiting = &self->waiting[i];
        if (waiting->sent_ns <= *start_ns && priority(&waiting->frame) < priority(&self->waiting[best].frame)) {
            best = i;
        }
    }
    return best;
}

/* The next frame to arrive, and the time at which it has arrived. At least one frame must wait. */
static size_t find_next(const loopback_t *self, uint64_t *end_ns)
{
    if (self->bitrate == 0) {
        *end_ns = self->waiting[0].sent_ns;
        return 0;
    }
    size_t next = arbitrate(self, end_ns);
    *end_ns += can_frame_bits(&self->waiting[next].frame) * NS_PER_S / self->bitrate;
    return next;
}

static void wait_until(const loopback_t *self, uint64_t when_ns)
{
    uint64_t now = now_ns(self);
    if (when_ns > now && self->bus.clock.wait_us != NULL) {
        self->bus.clock.wait_us(self->bus.clock.context, (uint32_t)((when_ns - now + NS_PER_US - 1) / NS_PER_US));
    }
}

static void remove_frame(loopback_t *self, size_t i)
{
    self->count--;
    memmove(&self->waiting[i], &self->waiting[i + 1], (self->count - i) * sizeof self->waiting[0]);
}

static dahl_can_result_t loopback_receive(dahl_can_bus_t *bus, dahl_can_frame_t *frame, uint32_t timeout_us)
{
    loopback_t *self = self_of(bus);
    uint64_t limit_ns = now_ns(self) + timeout_us * NS_PER_US, end_ns = UINT64_MAX;
    size_t next = self->count > 0 ? find_next(self, &end_ns) : 0;
    if (end_ns > limit_ns) {
        wait_until(self, limit_ns);
        return DAHL_CAN_BUS_NONE;
    }
    wait_until(self, end_ns);
    self->free_ns = end_ns;
    *frame = self->waiting[next].frame;
    frame->time_us = self->bitrate == 0 ? end_ns / NS_PER_US : dahl_can_clock_now_us(&bus->clock);
    remove_frame(self, next);
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

void loopback_open(loopback_t *self, uint32_t bitrate, dahl_can_clock_t clock)
{
    static const dahl_can_bus_ops_t ops = {loopback_send, loopback_receive, loopback_peers, loopback_close};
    self->bus = (dahl_can_bus_t){.ops = &ops, .clock = clock};
    self->bitrate = bitrate;
    self->free_ns = 0;
    self->room = bitrate == 0 ? LOOPBACK_ROOM : LOOPBACK_TIMED_ROOM;
    self->count = 0;
}

/* SPDX-License-Identifier: MIT */
/* wire: see wire.h. */
#include "wire.h"

#include <stdbool.h>
#include <string.h>

enum { CRC_POLYNOMIAL = 0x4599, TAIL_BITS = 13 }; /* delimiters, ACK, end of frame, pause of 3 bits: never stuffed */

typedef struct {
    uint32_t count; /* bits so far */
    uint32_t run;   /* equal bits in a row */
    uint32_t last;
    uint32_t crc;
} bits_t;

static void put_bit(bits_t *bits, uint32_t bit)
{
    bool invert = (bit ^ (bits->crc >> 14)) != 0;
    bits->crc = (bits->crc << 1) & 0x7FFFu;
    bits->crc ^= invert ? (uint32_t)CRC_POLYNOMIAL : 0u;
    bits->run = bits->count > 0 && bit == bits->last ? bits->run + 1 : 1;
    bits->last = bit;
    bits->count++;
    if (bits->run == 5) { /* a stuff bit, of the other kind */
        bits->last = 1 - bit;
        bits->run = 1;
        bits->count++;
    }
}

static void put(bits_t *bits, uint32_t value, uint32_t width)
{
    while (width-- > 0) {
        put_bit(bits, (value >> width) & 1u);
    }
}

static void put_header(bits_t *bits, const can_frame_t *frame)
{
    uint32_t remote = (frame->flags & CAN_FRAME_REMOTE) != 0 ? 1u : 0u;
    put(bits, 0, 1);
    if ((frame->flags & CAN_FRAME_EXTENDED) != 0) {
        put(bits, frame->id >> 18, 11);
        put(bits, 3, 2);
        put(bits, frame->id & 0x3FFFFu, 18);
        put(bits, remote << 2, 3);
    } else {
        put(bits, frame->id, 11);
        put(bits, remote << 2, 3);
    }
    put(bits, frame->length, 4);
}

uint32_t wire_bits(const can_frame_t *frame)
{
    bits_t bits = {0};
    put_header(&bits, frame);
    for (uint32_t i = 0; i < frame->length && (frame->flags & CAN_FRAME_REMOTE) == 0; i++) {
        put(&bits, frame->data[i], 8);
    }
    put(&bits, bits.crc, 15);
    return bits.count + TAIL_BITS;
}

static wire_t *self_of(can_bus_t *bus)
{
    return (wire_t *)(void *)bus;
}

static uint64_t now_ns(const wire_t *self)
{
    return self->bus.clock.now_ns(self->bus.clock.context);
}

static can_result_t wire_send(can_bus_t *bus, const can_frame_t *frame)
{
    wire_t *self = self_of(bus);
    if (self->count == WIRE_ROOM) {
        bus->counts.dropped++;
        return CAN_BUS_BUSY;
    }
    self->waiting[self->count] = (wire_frame_t){*frame, now_ns(self)};
    self->waiting[self->count++].frame.flags |= CAN_FRAME_OWN;
    return CAN_BUS_OK;
}

/* What goes first on the bus has the smaller number. */
static uint64_t priority(const can_frame_t *frame)
{
    if ((frame->flags & CAN_FRAME_EXTENDED) != 0) {
        return (uint64_t)(frame->id >> 18) << 19 | 1u << 18 | (frame->id & 0x3FFFFu);
    }
    return (uint64_t)frame->id << 19;
}

/* The frame that wins the bus as soon as it is free; *start_ns: when. There is one. */
static size_t winner(const wire_t *self, uint64_t *start_ns)
{
    size_t best = 0;
    *start_ns = self->waiting[0].asked_ns > self->free_ns ? self->waiting[0].asked_ns : self->free_ns;
    for (size_t i = 1; i < self->count; i++) {
        const wire_frame_t *waiting = &self->waiting[i];
        if (waiting->asked_ns <= *start_ns && priority(&waiting->frame) < priority(&self->waiting[best].frame)) {
            best = i;
        }
    }
    return best;
}

static void take(wire_t *self, size_t i, can_frame_t *frame)
{
    *frame = self->waiting[i].frame;
    frame->time_us = can_clock_now_us(&self->bus.clock);
    self->count--;
    memmove(&self->waiting[i], &self->waiting[i + 1], (self->count - i) * sizeof self->waiting[0]);
}

static void wait_until(const wire_t *self, uint64_t when_ns)
{
    uint64_t now = now_ns(self);
    if (when_ns > now) {
        self->bus.clock.wait_us(self->bus.clock.context, (uint32_t)((when_ns - now + 999) / 1000));
    }
}

static can_result_t wire_receive(can_bus_t *bus, can_frame_t *frame, uint32_t timeout_us)
{
    wire_t *self = self_of(bus);
    uint64_t limit = now_ns(self) + (uint64_t)timeout_us * 1000u;
    uint64_t start;
    if (self->count > 0) {
        size_t first = winner(self, &start);
        uint64_t end = start + wire_bits(&self->waiting[first].frame) * UINT64_C(1000000000) / self->bitrate;
        if (end <= limit) {
            wait_until(self, end);
            self->free_ns = end;
            take(self, first, frame);
            return CAN_BUS_OK;
        }
    }
    wait_until(self, limit);
    return CAN_BUS_NONE;
}

static uint32_t wire_peers(const can_bus_t *bus)
{
    (void)bus;
    return 0;
}

static void wire_close(can_bus_t *bus)
{
    (void)bus;
}

void wire_open(wire_t *self, uint32_t bitrate, can_clock_t clock)
{
    static const can_bus_ops_t ops = {wire_send, wire_receive, wire_peers, wire_close};
    *self = (wire_t){.bus = {.ops = &ops, .clock = clock}, .bitrate = bitrate};
}

/* SPDX-License-Identifier: MIT */
#include "serial_bus.h"

static serial_bus_t *serial_of(dahl_can_bus_t *bus)
{
    return (serial_bus_t *)(void *)bus;
}

static void write_text(const serial_bus_t *self, const char *text)
{
    while (*text != '\0') {
        self->port.write((uint8_t)*text++);
    }
}

static dahl_can_result_t serial_send(dahl_can_bus_t *bus, const dahl_can_frame_t *frame)
{
    serial_bus_t *self = serial_of(bus);
    char text[SLCAN_TEXT_MAX];
    if (!self->slcan.open || slcan_write(frame, text) == 0) {
        bus->counts.dropped++;
        return DAHL_CAN_BUS_BUSY;
    }
    write_text(self, text);
    return DAHL_CAN_BUS_OK;
}

/* Read the bytes that have arrived, up to the end of a frame. Never waits. */
static dahl_can_result_t serial_receive(dahl_can_bus_t *bus, dahl_can_frame_t *frame, uint32_t timeout_us)
{
    serial_bus_t *self = serial_of(bus);
    char text[SLCAN_TEXT_MAX];
    uint8_t byte;
    (void)timeout_us;
    while (self->port.read(&byte)) {
        slcan_event_t event = slcan_take(&self->slcan, byte, frame, text);
        if (event != SLCAN_NOTHING) {
            bus->counts.garbage += text[0] == '\a';
            write_text(self, text);
        }
        if (event == SLCAN_FRAME) {
            frame->time_us = dahl_can_clock_now_us(&bus->clock);
            return DAHL_CAN_BUS_OK;
        }
    }
    return DAHL_CAN_BUS_NONE;
}

static uint32_t peers(const dahl_can_bus_t *bus)
{
    return ((const serial_bus_t *)(const void *)bus)->slcan.open ? 1u : 0u;
}

static void serial_close(dahl_can_bus_t *bus)
{
    serial_of(bus)->slcan.open = false;
}

void serial_bus_open(serial_bus_t *self, serial_port_t port, dahl_can_clock_t clock)
{
    static const dahl_can_bus_ops_t ops = {serial_send, serial_receive, peers, serial_close};
    *self = (serial_bus_t){.bus = {.ops = &ops, .clock = clock}, .port = port};
}

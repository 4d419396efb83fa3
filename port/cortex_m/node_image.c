/* SPDX-License-Identifier: MIT */
/*
 * The friction node as a firmware image: lib/node/node.c unchanged, on a serial port with slcan.
 * A page of flash (param_page, at the address in the board's linker script) holds the parameters, so that they can be
 * calibrated in the field. If the page is blank, the defaults below apply. If dahl_prepare refuses the parameters, slcan works
 * but the node does not answer: no torque is better than a wrong one.
 */
#include <stddef.h>

#include "cortex_m.h"
#include "dahl_node.h"
#include "slcan/serial_bus.h"

#define PAGE_WRITTEN 0x4C484144u /* "DAHL" */

typedef struct {
    uint32_t written;
    dahl_params_t params;
    uint32_t number;     /* of the node, 0..15 */
    uint32_t timeout_us; /* 0: DAHL_NODE_TIMEOUT_US */
} param_page_t;

extern const param_page_t param_page;

static const param_page_t defaults = {
    PAGE_WRITTEN, {.sigma0 = 36500.0f, .Fc = 2.7f, .theta_per_count = 1e-7f}, 0, 0,
};

static dahl_node_t node;
static serial_bus_t serial;

static uint64_t now_ns(void *context)
{
    (void)context;
    return (uint64_t)tick_now_us() * 1000u;
}

static const param_page_t *find_params(void)
{
    const volatile uint32_t *written = &param_page.written; /* volatile: the page is written apart from the image */
    return *written == PAGE_WRITTEN ? &param_page : &defaults;
}

static void serve(bool is_ready)
{
    dahl_can_frame_t in, out;
    uint32_t now_us = tick_now_us();
    bool has_frame = dahl_can_bus_receive(&serial.bus, &in, 0) == DAHL_CAN_BUS_OK;
    if (is_ready && has_frame && dahl_node_receive(&node, &in, now_us, &out)) {
        dahl_can_bus_send(&serial.bus, &out);
    }
    if (!has_frame) {
        uart_wait();
    }
    if (is_ready && serial.slcan.open && dahl_node_tick(&node, now_us, &out)) {
        dahl_can_bus_send(&serial.bus, &out);
    }
}

int main(void)
{
    const param_page_t *page = find_params();
    bool is_ready = dahl_node_init(&node, &page->params, (uint8_t)page->number) == DAHL_OK;
    node.timeout_us = page->timeout_us != 0 ? page->timeout_us : DAHL_NODE_TIMEOUT_US;
    uart_start();
    tick_start();
    serial_bus_open(&serial, (serial_port_t){uart_read, uart_write}, (dahl_can_clock_t){now_ns, NULL, NULL});
    for (;;) {
        serve(is_ready);
    }
}

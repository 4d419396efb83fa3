/* SPDX-License-Identifier: MIT */
/* The UART of Nordic's nRF51, on the microbit. The board's linker script says where it is. */
#include "cortex_m.h"

extern char uart_base[];

enum { START_RX = 0x000, START_TX = 0x008, RX_READY = 0x108, TX_READY = 0x11C, ENABLE = 0x500, RX = 0x518, TX = 0x51C };
enum { ENABLE_UART = 4 };

static volatile uint32_t *port(uint32_t offset)
{
    return (volatile uint32_t *)(void *)(uart_base + offset);
}

void uart_start(void)
{
    *port(ENABLE) = ENABLE_UART;
    *port(START_RX) = 1;
    *port(START_TX) = 1;
}

bool uart_read(uint8_t *byte)
{
    if (!*port(RX_READY)) {
        return false;
    }
    *port(RX_READY) = 0;
    *byte = (uint8_t)*port(RX);
    return true;
}

void uart_write(uint8_t byte)
{
    *port(TX_READY) = 0;
    *port(TX) = byte;
    while (!*port(TX_READY)) {
    }
}

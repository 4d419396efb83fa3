/* SPDX-License-Identifier: MIT */
/* The UART of Nordic's nRF51, on the microbit. The board's linker script gives its address and its interrupt. */
#include "cortex_m.h"

extern char uart_base[], uart_interrupt[];

enum { START_RX = 0x000, START_TX = 0x008, RX_READY = 0x108, TX_READY = 0x11C, INTERRUPT_ON = 0x304 };
enum { ENABLE = 0x500, RX = 0x518, TX = 0x51C };
enum { ENABLE_UART = 4, INTERRUPT_RX = 4 };

static volatile uint32_t *port(uint32_t offset)
{
    return (volatile uint32_t *)(void *)(uart_base + offset);
}

void uart_start(void)
{
    *port(ENABLE) = ENABLE_UART;
    *port(INTERRUPT_ON) = INTERRUPT_RX;
    *port(START_RX) = 1;
    *port(START_TX) = 1;
}

static bool has_byte(void)
{
    return *port(RX_READY) != 0;
}

bool uart_read(uint8_t *byte)
{
    if (!has_byte()) {
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

void uart_wait(void)
{
    cortex_wait((uint32_t)(uintptr_t)uart_interrupt, has_byte);
}

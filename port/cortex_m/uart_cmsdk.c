/* SPDX-License-Identifier: MIT */
/* Arm's CMSDK UART, the first port of the mps2 boards. The board's linker script gives its address and its interrupt. */
#include "cortex_m.h"

extern char uart_base[], uart_interrupt[];

enum { DATA = 0x0, STATE = 0x4, CONTROL = 0x8, INTERRUPT = 0xC, DIVIDER = 0x10 };
enum { STATE_TX_FULL = 1, STATE_RX_FULL = 2 };
enum { CONTROL_TX_RX = 3, CONTROL_RX_INTERRUPT = 8, INTERRUPT_RX = 2, DIVIDER_LEAST = 16 };

static volatile uint32_t *port(uint32_t offset)
{
    return (volatile uint32_t *)(void *)(uart_base + offset);
}

void uart_start(void)
{
    *port(DIVIDER) = DIVIDER_LEAST;
    *port(CONTROL) = CONTROL_TX_RX | CONTROL_RX_INTERRUPT;
}

static bool has_byte(void)
{
    return (*port(STATE) & STATE_RX_FULL) != 0;
}

bool uart_read(uint8_t *byte)
{
    if (!has_byte()) {
        return false;
    }
    *port(INTERRUPT) = INTERRUPT_RX;
    *byte = (uint8_t)*port(DATA);
    return true;
}

void uart_write(uint8_t byte)
{
    while (*port(STATE) & STATE_TX_FULL) {
    }
    *port(DATA) = byte;
}

void uart_wait(void)
{
    cortex_wait((uint32_t)(uintptr_t)uart_interrupt, has_byte);
}

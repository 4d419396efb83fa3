/* SPDX-License-Identifier: MIT */
/* Arm's CMSDK UART, the first port of the mps2 boards. The board's linker script says where it is. */
#include "cortex_m.h"

extern char uart_base[];

enum { DATA = 0x0, STATE = 0x4, CONTROL = 0x8, DIVIDER = 0x10 };
enum { STATE_TX_FULL = 1, STATE_RX_FULL = 2, CONTROL_TX_RX = 3, DIVIDER_LEAST = 16 };

static volatile uint32_t *port(uint32_t offset)
{
    return (volatile uint32_t *)(void *)(uart_base + offset);
}

void uart_start(void)
{
    *port(DIVIDER) = DIVIDER_LEAST;
    *port(CONTROL) = CONTROL_TX_RX;
}

bool uart_read(uint8_t *byte)
{
    if (!(*port(STATE) & STATE_RX_FULL)) {
        return false;
    }
    *byte = (uint8_t)*port(DATA);
    return true;
}

void uart_write(uint8_t byte)
{
    while (*port(STATE) & STATE_TX_FULL) {
    }
    *port(DATA) = byte;
}

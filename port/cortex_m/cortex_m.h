/* SPDX-License-Identifier: MIT */
/*
 * cortex_m: functions of the core and the board that an image needs. Each variant of a function is in a separate file; an image
 * selects one by linking:
 *   core_init      fpu_on.c | fpu_none.c
 *   cortex_exit    exit_semihosting.c (ends QEMU, for tests) | exit_reset.c (starts over, for firmware)
 *   cortex_tick    tick.c (SysTick, 1 ms) | no_tick.c
 *   uart_*         uart_cmsdk.c (mps2 boards) | uart_nrf51.c (microbit)
 */
#ifndef CORTEX_M_H
#define CORTEX_M_H

#include <stdbool.h>
#include <stdint.h>

#define CORTEX_REGISTER(address) (*(volatile uint32_t *)(uintptr_t)(address))

void core_init(void);
void cortex_tick(void);
void cortex_exit(int status) __attribute__((noreturn));
void cortex_fault(void) __attribute__((noreturn));

/* Start SysTick, and return the microseconds since, modulo 2^32. */
void tick_start(void);
uint32_t tick_now_us(void);

/* The serial port. uart_read returns false if no byte has arrived. uart_write waits for room. uart_wait sleeps until a byte
 * arrives or an interrupt is handled. */
void uart_start(void);
bool uart_read(uint8_t *byte);
void uart_write(uint8_t byte);
void uart_wait(void);

/* Sleep until interrupt `number` or another one is pending, unless ready() returns true. Interrupt `number` only wakes the core
 * and needs no handler. */
void cortex_wait(uint32_t number, bool (*ready)(void));

#endif

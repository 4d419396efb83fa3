/* SPDX-License-Identifier: MIT */
/* The hardware of the drive. board_qemu.c simulates it; write your own file for your board. */
#ifndef BOARD_H
#define BOARD_H

#include <dahl_can_bus.h>

enum { BOARD_SPI_BYTES = 4, BOARD_SLOTS = 2 };
typedef enum { BOARD_POWER_ON = 0, BOARD_WATCHDOG = 1 } board_reset_t;

/* Start clocks, SPI, CAN, PWM at torque 0, and a watchdog of 20 ms. From then on, a timer calls drive_tick() each ms. */
void board_start(void);
board_reset_t board_reset_cause(void);

/* In the interrupt of the timer */
void board_encoder(uint8_t frame[BOARD_SPI_BYTES]); /* the last SPI frame, which the timer has started */
void board_torque(float torque);                    /* N m, to the current loop */
void board_watchdog_feed(void);

/* In the main program. A slot is a page of flash: a write erases it to 0xFF, then programs it. If this takes more than 20 ms,
 * let board_flash_write() feed the watchdog: the motor is off. */
void board_wait(void); /* sleep until an interrupt was handled */
bool board_can_receive(dahl_can_frame_t *frame);
void board_can_send(const dahl_can_frame_t *frame);
void board_flash_read(uint32_t slot, void *to, uint32_t bytes);
void board_flash_write(uint32_t slot, const void *from, uint32_t bytes);

#endif

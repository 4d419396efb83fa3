/* SPDX-License-Identifier: MIT */
#ifndef CAN_NODE_H
#define CAN_NODE_H

#include <stdint.h>

/* Functions of your board. */
typedef struct {
    /* Send bytes on SPI (mode 0, at most 10 MHz) with chip select low, and replace them by the received ones. */
    void (*transfer)(uint8_t *bytes, uint8_t length);
    uint32_t (*clock_us)(void); /* a free-running clock; it may wrap at 2^32 us */
    void (*wait_us)(uint32_t us);
    void (*mask)(void); /* mask the interrupt of pin INT, and unmask it */
    void (*unmask)(void);
} can_board_t;

extern volatile uint32_t can_dropped; /* frames that were not sent, because their transmit buffer was full */

#define CAN_NODE_NO_CHIP 1

/* Start node and controller. `functions` must stay valid. Returns 0, CAN_NODE_NO_CHIP or the code of dahl_node_init(). */
int can_node_init(const can_board_t *functions);

void can_node_interrupt(void); /* call it if pin INT falls */

void can_node_tick(void); /* call it in the main loop, about every millisecond */

#endif

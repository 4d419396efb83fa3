/* SPDX-License-Identifier: MIT */
#ifndef CAN_NODE_H
#define CAN_NODE_H

#include <stdint.h>

extern volatile uint32_t can_dropped; /* frames that were not sent, because the transmit queue was full or the bus was off */

/* Start node and controller. Returns 0, the code of dahl_node_init() or that of the driver. */
int can_node_init(void);

/* Wait at most one tick of FreeRTOS for a frame, and serve the node. Call it in a loop of one task. */
void can_node_serve(void);

#endif

/* SPDX-License-Identifier: MIT */
#ifndef CAN_NODE_H
#define CAN_NODE_H

#include <zephyr/device.h>

extern volatile uint32_t can_dropped; /* frames that were not sent, because the transmit queue was full or the bus was off */

/* Start node and controller. Returns 0, or the negative code of dahl_node_init() or of the driver. */
int can_node_init(const struct device *can);

/* Wait at most 1 ms for a frame, and serve the node. Call it in a loop of one thread. */
void can_node_serve(void);

#endif

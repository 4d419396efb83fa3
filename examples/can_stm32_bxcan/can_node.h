/* SPDX-License-Identifier: MIT */
#ifndef CAN_NODE_H
#define CAN_NODE_H

#include <stdint.h>

uint32_t clock_us(void); /* yours: a free-running clock; it may wrap at 2^32 us */

extern volatile uint32_t can_dropped; /* frames that were not sent, because all mailboxes were full */

#define CAN_NODE_NO_CLOCK 1

#ifndef CAN_NODE_UNIT
#define CAN_NODE_UNIT 1 /* 2 for CAN2 */
#endif

/* Start node and controller. Returns 0, CAN_NODE_NO_CLOCK or the code of dahl_node_init(): the interrupts then stay off. */
int can_node_init(void);

void can_node_tick(void); /* call it in the main loop, about every millisecond */

void CAN1_RX0_IRQHandler(void); /* those of the unit are defined */
void CAN1_SCE_IRQHandler(void);
void CAN2_RX0_IRQHandler(void);
void CAN2_SCE_IRQHandler(void);

#endif

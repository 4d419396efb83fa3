/* SPDX-License-Identifier: MIT */
/* Registers of bxCAN that can_node.c uses; offsets and bits as in RM0090. Replace this file by the CMSIS header of your part.
 * With HOST_REGISTERS a test on a PC models them. */
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stdint.h>

typedef struct {
    volatile uint32_t IR, DTR, DLR, DHR; /* identifier; length; data bytes 0 .. 3 and 4 .. 7, the first in the lowest bits */
} bxcan_mailbox_t;

typedef struct {
    volatile uint32_t MCR, MSR, TSR, RF0R, RF1R, IER, ESR, BTR; /* 0x000 */
    uint32_t reserved_020[88];
    bxcan_mailbox_t tx[3], rx[2]; /* 0x180, 0x1B0 */
    uint32_t reserved_1d0[12];
    volatile uint32_t FMR, FM1R; /* 0x200 */
    uint32_t reserved_208;
    volatile uint32_t FS1R; /* 0x20C */
    uint32_t reserved_210;
    volatile uint32_t FFA1R; /* 0x214 */
    uint32_t reserved_218;
    volatile uint32_t FA1R; /* 0x21C */
    uint32_t reserved_220[8];
    volatile uint32_t filter[28][2]; /* 0x240 */
} bxcan_t;

#ifdef HOST_REGISTERS
bxcan_t *can1(void);
bxcan_t *can2(void);
uint32_t *nvic_iser0(void);
void mask_interrupts(void);
void unmask_interrupts(void);
#define CAN1 can1()
#define CAN2 can2()
#define NVIC_ISER nvic_iser0()
#else
#define CAN1 ((bxcan_t *)0x40006400u)
#define CAN2 ((bxcan_t *)0x40006800u)
#define NVIC_ISER ((volatile uint32_t *)0xE000E100u)
#define mask_interrupts() __asm volatile("cpsid i" ::: "memory")
#define unmask_interrupts() __asm volatile("cpsie i" ::: "memory")
#endif

#define CAN_MCR_INRQ (1u << 0)
#define CAN_MCR_TXFP (1u << 2) /* mailboxes are sent in the order of their requests */
#define CAN_MCR_ABOM (1u << 6) /* recovery from bus-off after 128 times 11 recessive bits */
#define CAN_MSR_INAK (1u << 0)
#define CAN_MSR_ERRI (1u << 2)
#define CAN_TSR_ABRQ (1u << 7 | 1u << 15 | 1u << 23) /* of all mailboxes */
#define CAN_TSR_CODE_SHIFT 24u                       /* number of the next free mailbox, 2 bits */
#define CAN_TSR_TME (7u << 26)
#define CAN_RF0R_FMP0 3u
#define CAN_RF0R_RFOM0 (1u << 5)
#define CAN_IER_FMPIE0 (1u << 1)
#define CAN_IER_BOFIE (1u << 10)
#define CAN_IER_ERRIE (1u << 15)
#define CAN_ESR_BOFF (1u << 2)
#define CAN_IR_TXRQ (1u << 0)
#define CAN_IR_RTR (1u << 1)
#define CAN_IR_IDE (1u << 2)
#define CAN_IR_STID_SHIFT 21u
#define CAN_IR_EXID_SHIFT 3u
#define CAN_DTR_DLC 15u
#define CAN_FMR_FINIT (1u << 0)

#if CAN_NODE_UNIT == 1
#define CAN CAN1
#define CAN_BANK 0
#define CAN_RX0_IRQ 20
#define CAN_SCE_IRQ 22
#define CAN_RX0_IRQHandler CAN1_RX0_IRQHandler
#define CAN_SCE_IRQHandler CAN1_SCE_IRQHandler
#else
#define CAN CAN2
#define CAN_BANK 14 /* the first of CAN2, unless CAN2SB of FMR was changed since reset */
#define CAN_RX0_IRQ 64
#define CAN_SCE_IRQ 66
#define CAN_RX0_IRQHandler CAN2_RX0_IRQHandler
#define CAN_SCE_IRQHandler CAN2_SCE_IRQHandler
#endif

#endif

/* SPDX-License-Identifier: MIT */
/* Registers and message RAM of FDCAN that can_node.c uses; offsets and bits as in RM0440. STM32H7 has other ones. Replace this
 * file by the CMSIS header of your part. With HOST_REGISTERS a test on a PC models them. */
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stdint.h>

typedef struct {
    uint32_t reserved_000[6];
    volatile uint32_t CCCR, NBTP; /* 0x018 */
    uint32_t reserved_020[9];
    volatile uint32_t PSR; /* 0x044 */
    uint32_t reserved_048[2];
    volatile uint32_t IR, IE, ILS, ILE; /* 0x050 */
    uint32_t reserved_060[8];
    volatile uint32_t RXGFC; /* 0x080 */
    uint32_t reserved_084[3];
    volatile uint32_t RXF0S, RXF0A; /* 0x090 */
    uint32_t reserved_098[11];
    volatile uint32_t TXFQS, TXBRP, TXBAR; /* 0x0C4 */
} fdcan_t;

typedef struct {
    volatile uint32_t id, length, data[16]; /* data: bytes, the first in the lowest bits */
} fdcan_element_t;

/* The layout is fixed. FDCAN2 and FDCAN3 have theirs 0x350 and 0x6A0 bytes later. */
typedef struct {
    volatile uint32_t standard_filter[28];  /* 0x000 */
    volatile uint32_t extended_filter[8][2]; /* 0x070 */
    fdcan_element_t rx0[3], rx1[3];          /* 0x0B0, 0x188 */
    volatile uint32_t tx_event[3][2];        /* 0x260 */
    fdcan_element_t tx[3];                   /* 0x278 */
} fdcan_ram_t;

#ifdef HOST_REGISTERS
fdcan_t *fdcan1(void);
fdcan_ram_t *fdcan1_ram(void);
uint32_t *nvic_iser0(void);
void mask_interrupts(void);
void unmask_interrupts(void);
#define FDCAN1 fdcan1()
#define FDCAN1_RAM fdcan1_ram()
#define NVIC_ISER0 (*nvic_iser0())
#else
#define FDCAN1 ((fdcan_t *)0x40006400u)
#define FDCAN1_RAM ((fdcan_ram_t *)0x4000A400u)
#define NVIC_ISER0 (*(volatile uint32_t *)0xE000E100u)
#define mask_interrupts() __asm volatile("cpsid i" ::: "memory")
#define unmask_interrupts() __asm volatile("cpsie i" ::: "memory")
#endif

#define FDCAN_CCCR_INIT (1u << 0)
#define FDCAN_CCCR_CCE (1u << 1) /* configuration; also clears both FIFOs */
#define FDCAN_PSR_BO (1u << 7)
#define FDCAN_IR_RF0N (1u << 0) /* IE has the same bits */
#define FDCAN_IR_BO (1u << 19)
#define FDCAN_RXGFC_REJECT (3u | 2u << 2 | 2u << 4) /* remote frames, and frames that pass no filter */
#define FDCAN_RXGFC_LSS_SHIFT 16u                   /* number of standard filters */
#define FDCAN_RXF0S_F0FL 15u                        /* fill level */
#define FDCAN_RXF0S_F0GI_SHIFT 8u                   /* index of the oldest frame, 2 bits */
#define FDCAN_TXFQS_TFQPI_SHIFT 16u                 /* index of the next free element, 2 bits */
#define FDCAN_TXFQS_TFQF (1u << 21)
#define FDCAN_FILTER_MASK_TO_FIFO0 (2u << 30 | 1u << 27)
#define FDCAN_FILTER_ID_SHIFT 16u
#define FDCAN_ELEMENT_ID_SHIFT 18u /* of a standard identifier */
#define FDCAN_ELEMENT_DLC_SHIFT 16u
#define FDCAN1_IT0_IRQ 21u

#endif

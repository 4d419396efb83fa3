/* SPDX-License-Identifier: MIT */
/* The friction node on the bxCAN of an STM32F4 or STM32F1 at 500 kbit/s, by RM0090 and RM0008. It was not run on hardware. Your
 * start-up code turns on the clock and pins of CAN1 (for CAN2 the clock of both), sets APB1 to APB1_MHZ, and calls can_node_init().
 * That of an STM32F103 calls the first interrupt USB_LP_CAN1_RX0_IRQHandler. */
#include <string.h>
#include <dahl_node.h>
#include "can_node.h"
#include "registers.h"

#define ID (DAHL_FRAMES_ID_ENCODER | 0u) /* of node 0 */
#define ID_MASK 0x70Fu                   /* passes 0x100, 0x110 .. 0x170; the node ignores those it does not use */

/* Clock of the controller: 42 on an STM32F4 at 168 MHz, 36 on an STM32F1 at 72 MHz. Bits have 1 + 11 + 2 quanta, sampled at 86 %,
 * or 1 + 15 + 2, sampled at 89 %. */
#ifndef APB1_MHZ
#define APB1_MHZ 42
#endif
#if APB1_MHZ == 42
#define BIT_TIMING (1u << 20 | 10u << 16 | 5u) /* 42 MHz / 6 */
#elif APB1_MHZ == 36
#define BIT_TIMING (1u << 20 | 14u << 16 | 3u) /* 36 MHz / 4 */
#else
#error "set BIT_TIMING for this clock of APB1"
#endif

static const dahl_params_t params = {100.0f, 0.5f, 6.2831853f / 16384}; /* sigma0 N m/rad, Fc N m, rad/count */
static dahl_node_t node;
volatile uint32_t can_dropped;

/* Pass ID into FIFO 0 by one bank of 32 bits, and keep the other banks. The registers of CAN1 have the banks of CAN2, too. A warm
 * start may have left the bank active, which locks it. */
static void set_filter(void)
{
    CAN1->FMR |= CAN_FMR_FINIT;
    CAN1->FA1R &= ~(1u << CAN_BANK);
    CAN1->FM1R &= ~(1u << CAN_BANK); /* identifier and mask */
    CAN1->FS1R |= 1u << CAN_BANK;    /* one filter of 32 bits */
    CAN1->FFA1R &= ~(1u << CAN_BANK);
    CAN1->filter[CAN_BANK][0] = ID << CAN_IR_STID_SHIFT;
    CAN1->filter[CAN_BANK][1] = ID_MASK << CAN_IR_STID_SHIFT | CAN_IR_IDE | CAN_IR_RTR;
    CAN1->FA1R |= 1u << CAN_BANK;
    CAN1->FMR &= ~CAN_FMR_FINIT;
}

int can_node_init(void)
{
    uint32_t polls = 100000; /* some ms; a frame on the bus delays INAK by .3 ms */
    CAN->MCR = CAN_MCR_INRQ | CAN_MCR_ABOM | CAN_MCR_TXFP;
    while ((CAN->MSR & CAN_MSR_INAK) == 0 && --polls > 0) {
    }
    CAN->BTR = BIT_TIMING;
    set_filter();
    CAN->IER = CAN_IER_FMPIE0 | CAN_IER_BOFIE | CAN_IER_ERRIE;
    CAN->MCR = CAN_MCR_ABOM | CAN_MCR_TXFP;
    int code = polls == 0 ? CAN_NODE_NO_CLOCK : dahl_node_init(&node, &params, ID & 15);
    uint32_t interrupts = 1u << CAN_RX0_IRQ % 32 | 1u << CAN_SCE_IRQ % 32; /* both must have the same priority */
    NVIC_ISER[CAN_RX0_IRQ / 32] = code == DAHL_OK ? interrupts : 0;
    return code;
}

static void send(const dahl_can_frame_t *frame)
{
    uint32_t status = CAN->TSR, data[2];
    if ((status & CAN_TSR_TME) == 0) {
        can_dropped++;
        return;
    }
    bxcan_mailbox_t *mailbox = &CAN->tx[status >> CAN_TSR_CODE_SHIFT & 3];
    memcpy(data, frame->data, 8); /* registers need accesses of 32 bits */
    mailbox->DTR = frame->length;
    mailbox->DLR = data[0];
    mailbox->DHR = data[1];
    mailbox->IR = frame->id << CAN_IR_STID_SHIFT | CAN_IR_TXRQ;
}

void CAN_RX0_IRQHandler(void)
{
    const bxcan_mailbox_t *mailbox = &CAN->rx[0];
    uint32_t length = mailbox->DTR & CAN_DTR_DLC, data[2] = {mailbox->DLR, mailbox->DHR};
    dahl_can_frame_t out, in = {.id = mailbox->IR >> CAN_IR_STID_SHIFT, .length = (uint8_t)(length < 8 ? length : 8)};
    bool has_frame = (CAN->RF0R & CAN_RF0R_FMP0) != 0;
    CAN->RF0R = CAN_RF0R_RFOM0; /* if the FIFO has another frame, the interrupt repeats */
    memcpy(in.data, data, 8);
    if (has_frame && dahl_node_receive(&node, &in, clock_us(), &out)) {
        send(&out);
    }
}

void CAN_SCE_IRQHandler(void)
{
    if ((CAN->ESR & CAN_ESR_BOFF) != 0) {
        CAN->TSR = CAN_TSR_ABRQ; /* the controller recovers by itself, and must not send old torques */
        dahl_node_bus_off(&node, clock_us());
    }
    CAN->MSR = CAN_MSR_ERRI;
}

void can_node_tick(void)
{
    dahl_can_frame_t out;
    mask_interrupts(); /* the interrupts use the node and the mailboxes, too */
    if (dahl_node_tick(&node, clock_us(), &out)) {
        send(&out);
    }
    unmask_interrupts();
}

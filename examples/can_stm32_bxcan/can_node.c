/* SPDX-License-Identifier: MIT */
/* The friction node on the bxCAN of an STM32F4 at 500 kbit/s, by RM0090; RM0008 (STM32F1) has the same registers. It was not
 * run on hardware. Your start-up code turns on the clock and pins of CAN1, sets APB1 to 42 MHz, and calls can_node_init(). */
#include <string.h>
#include <dahl_node.h>
#include "can_node.h"
#include "registers.h"

#define ID (DAHL_FRAMES_ID_ENCODER | 0u)       /* of node 0 */
#define ID_MASK 0x70Fu                         /* passes 0x100, 0x110 .. 0x170; the node ignores those it does not use */
#define BIT_TIMING (1u << 20 | 10u << 16 | 5u) /* 42 MHz / 6; bits of 1 + 11 + 2 quanta, sampled at 86 % */
static const dahl_params_t params = {100.0f, 0.5f, 6.2831853f / 16384}; /* sigma0 N m/rad, Fc N m, rad/count */
static dahl_node_t node;
volatile uint32_t can_dropped;

int can_node_init(void)
{
    uint32_t polls = 100000; /* some ms; a frame on the bus delays INAK by .3 ms */
    CAN1->MCR = CAN_MCR_INRQ | CAN_MCR_ABOM | CAN_MCR_TXFP;
    while ((CAN1->MSR & CAN_MSR_INAK) == 0 && --polls > 0) {
    }
    CAN1->BTR = BIT_TIMING;
    CAN1->FS1R = 1; /* filter 0: 32 bits; as after reset, identifier and mask, into FIFO 0 */
    CAN1->filter[0][0] = ID << CAN_IR_STID_SHIFT;
    CAN1->filter[0][1] = ID_MASK << CAN_IR_STID_SHIFT | CAN_IR_IDE | CAN_IR_RTR;
    CAN1->FA1R = 1;
    CAN1->FMR &= ~CAN_FMR_FINIT;
    CAN1->IER = CAN_IER_FMPIE0 | CAN_IER_BOFIE | CAN_IER_ERRIE;
    CAN1->MCR = CAN_MCR_ABOM | CAN_MCR_TXFP;
    int code = polls == 0 ? CAN_NODE_NO_CLOCK : dahl_node_init(&node, &params, ID & 15);
    NVIC_ISER0 = code == DAHL_OK ? 1u << CAN1_RX0_IRQ | 1u << CAN1_SCE_IRQ : 0; /* both must have the same priority */
    return code;
}

static void send(const dahl_can_frame_t *frame)
{
    uint32_t status = CAN1->TSR, data[2];
    if ((status & CAN_TSR_TME) == 0) {
        can_dropped++;
        return;
    }
    bxcan_mailbox_t *mailbox = &CAN1->tx[status >> CAN_TSR_CODE_SHIFT & 3];
    memcpy(data, frame->data, 8); /* registers need accesses of 32 bits */
    mailbox->DTR = frame->length;
    mailbox->DLR = data[0];
    mailbox->DHR = data[1];
    mailbox->IR = frame->id << CAN_IR_STID_SHIFT | CAN_IR_TXRQ;
}

void CAN1_RX0_IRQHandler(void)
{
    const bxcan_mailbox_t *mailbox = &CAN1->rx[0];
    uint32_t length = mailbox->DTR & CAN_DTR_DLC, data[2] = {mailbox->DLR, mailbox->DHR};
    dahl_can_frame_t out, in = {.id = mailbox->IR >> CAN_IR_STID_SHIFT, .length = (uint8_t)(length < 8 ? length : 8)};
    bool has_frame = (CAN1->RF0R & CAN_RF0R_FMP0) != 0;
    CAN1->RF0R = CAN_RF0R_RFOM0; /* if the FIFO has another frame, the interrupt repeats */
    memcpy(in.data, data, 8);
    if (has_frame && dahl_node_receive(&node, &in, clock_us(), &out)) {
        send(&out);
    }
}

void CAN1_SCE_IRQHandler(void)
{
    if ((CAN1->ESR & CAN_ESR_BOFF) != 0) {
        CAN1->TSR = CAN_TSR_ABRQ; /* the controller recovers by itself, and must not send old torques */
        dahl_node_bus_off(&node, clock_us());
    }
    CAN1->MSR = CAN_MSR_ERRI;
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

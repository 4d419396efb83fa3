/* SPDX-License-Identifier: MIT */
/* The friction node on the FDCAN of an STM32G4, with classic frames at 500 kbit/s, by RM0440. It was not run on hardware. Your
 * start-up code turns on the clock and pins of FDCAN1, sets its kernel clock to 170 MHz, and calls can_node_init(). */
#include <string.h>
#include <dahl_node.h>
#include "can_node.h"
#include "registers.h"

#define ID (DAHL_FRAMES_ID_ENCODER | 0u)        /* of node 0 */
#define ID_MASK 0x70Fu                          /* passes 0x100, 0x110 .. 0x170; the node ignores those it does not use */
#define BIT_TIMING (16u << 16 | 15u << 8 | 2u)  /* 170 MHz / 17; bits of 1 + 16 + 3 quanta, sampled at 85 % */
static const dahl_params_t params = {100.0f, 0.5f, 6.2831853f / 16384}; /* sigma0 N m/rad, Fc N m, rad/count */
static dahl_node_t node;
volatile uint32_t can_dropped;

int can_node_init(void)
{
    uint32_t polls = 100000; /* some ms; INIT passes two clock domains */
    FDCAN1->CCCR = FDCAN_CCCR_INIT;
    while ((FDCAN1->CCCR & FDCAN_CCCR_INIT) == 0 && --polls > 0) {
    }
    FDCAN1->CCCR = FDCAN_CCCR_INIT | FDCAN_CCCR_CCE;
    FDCAN1->NBTP = BIT_TIMING;
    FDCAN1->RXGFC = 1u << FDCAN_RXGFC_LSS_SHIFT | FDCAN_RXGFC_REJECT;
    FDCAN1_RAM->standard_filter[0] = FDCAN_FILTER_MASK_TO_FIFO0 | ID << FDCAN_FILTER_ID_SHIFT | ID_MASK;
    FDCAN1->IE = FDCAN_IR_RF0N | FDCAN_IR_BO;
    FDCAN1->ILE = 1; /* line 0 */
    FDCAN1->CCCR = 0;
    int code = polls == 0 ? CAN_NODE_NO_CLOCK : dahl_node_init(&node, &params, ID & 15);
    NVIC_ISER0 = code == DAHL_OK ? 1u << FDCAN1_IT0_IRQ : 0;
    return code;
}

static void send(const dahl_can_frame_t *frame)
{
    uint32_t index = FDCAN1->TXFQS >> FDCAN_TXFQS_TFQPI_SHIFT & 3, data[2];
    if ((FDCAN1->TXFQS & FDCAN_TXFQS_TFQF) != 0) {
        can_dropped++;
        return;
    }
    fdcan_element_t *element = &FDCAN1_RAM->tx[index];
    memcpy(data, frame->data, 8); /* the RAM needs accesses of 32 bits */
    element->id = frame->id << FDCAN_ELEMENT_ID_SHIFT;
    element->length = (uint32_t)frame->length << FDCAN_ELEMENT_DLC_SHIFT;
    element->data[0] = data[0];
    element->data[1] = data[1];
    FDCAN1->TXBAR = 1u << index;
}

void FDCAN1_IT0_IRQHandler(void)
{
    dahl_can_frame_t out;
    FDCAN1->IR = FDCAN_IR_RF0N | FDCAN_IR_BO;
    while ((FDCAN1->RXF0S & FDCAN_RXF0S_F0FL) != 0) {
        uint32_t index = FDCAN1->RXF0S >> FDCAN_RXF0S_F0GI_SHIFT & 3;
        const fdcan_element_t *element = &FDCAN1_RAM->rx0[index];
        uint32_t length = element->length >> FDCAN_ELEMENT_DLC_SHIFT & 15, data[2] = {element->data[0], element->data[1]};
        dahl_can_frame_t in = {.id = element->id >> FDCAN_ELEMENT_ID_SHIFT, .length = (uint8_t)(length < 8 ? length : 8)};
        memcpy(in.data, data, 8);
        FDCAN1->RXF0A = index;
        if (dahl_node_receive(&node, &in, clock_us(), &out)) {
            send(&out);
        }
    }
    if ((FDCAN1->PSR & FDCAN_PSR_BO) != 0 && (FDCAN1->CCCR & FDCAN_CCCR_INIT) != 0) {
        dahl_node_bus_off(&node, clock_us());
        FDCAN1->CCCR = FDCAN_CCCR_INIT | FDCAN_CCCR_CCE; /* drops old torques, which must not be sent later */
        FDCAN1->CCCR = 0;                                /* starts the recovery: 129 times 11 recessive bits */
    }
}

void can_node_tick(void)
{
    dahl_can_frame_t out;
    mask_interrupts(); /* the interrupt uses the node and the FIFO, too */
    if (dahl_node_tick(&node, clock_us(), &out)) {
        send(&out);
    }
    unmask_interrupts();
}

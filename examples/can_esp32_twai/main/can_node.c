/* SPDX-License-Identifier: MIT */
/* The friction node on the TWAI controller of an ESP32 at 500 kbit/s, by driver/twai.h of ESP-IDF v5. It was not run on
 * hardware. The driver's interrupt queues frames and one task serves them, so that no mask is needed. */
#include <string.h>
#include <dahl_node.h>
#include <driver/twai.h>
#include <esp_timer.h>
#include "can_node.h"

#define ID (DAHL_FRAMES_ID_ENCODER | 0u) /* of node 0 */
#define ID_MASK 0x70Fu                   /* passes 0x100, 0x110 .. 0x170; the node ignores those it does not use */
#define ID_SHIFT 21                      /* of a standard id in the filter; its other bits are those of RTR and data */
#define TX_PIN 5
#define RX_PIN 4
#define WAIT_TICKS 1 /* of FreeRTOS, for a frame */

static const dahl_params_t params = {100.0f, 0.5f, 6.2831853f / 16384}; /* sigma0 N m/rad, Fc N m, rad/count */
static dahl_node_t node;
static bool is_off; /* the bus */
volatile uint32_t can_dropped;

int can_node_init(void)
{
    twai_general_config_t general = TWAI_GENERAL_CONFIG_DEFAULT(TX_PIN, RX_PIN, TWAI_MODE_NORMAL);
    const twai_timing_config_t timing = TWAI_TIMING_CONFIG_500KBITS();
    const twai_filter_config_t filter = {ID << ID_SHIFT, ~(ID_MASK << ID_SHIFT), true}; /* mask: 1 passes both values */
    general.alerts_enabled = TWAI_ALERT_BUS_OFF | TWAI_ALERT_BUS_RECOVERED;
    int code = dahl_node_init(&node, &params, ID & 15);
    code = code != DAHL_OK ? code : twai_driver_install(&general, &timing, &filter);
    return code != ESP_OK ? code : twai_start();
}

static uint32_t clock_us(void)
{
    return (uint32_t)esp_timer_get_time();
}

static void send(const dahl_can_frame_t *frame)
{
    twai_message_t message = {.identifier = frame->id, .data_length_code = frame->length};
    memcpy(message.data, frame->data, 8);
    can_dropped += twai_transmit(&message, 0) != ESP_OK;
}

static void receive(const twai_message_t *message)
{
    uint8_t length = message->data_length_code < 8 ? message->data_length_code : 8;
    dahl_can_frame_t out, in = {.id = message->identifier, .length = length};
    in.flags = (message->extd ? DAHL_CAN_FRAME_EXTENDED : 0) | (message->rtr ? DAHL_CAN_FRAME_REMOTE : 0);
    memcpy(in.data, message->data, 8);
    if (dahl_node_receive(&node, &in, clock_us(), &out)) {
        send(&out);
    }
}

void can_node_serve(void)
{
    twai_message_t message;
    dahl_can_frame_t out;
    uint32_t alerts = 0;
    if (twai_receive(&message, WAIT_TICKS) == ESP_OK) {
        receive(&message);
    }
    twai_read_alerts(&alerts, 0);
    if ((alerts & TWAI_ALERT_BUS_OFF) != 0) {
        is_off = true;
        dahl_node_bus_off(&node, clock_us());
        twai_initiate_recovery(); /* drops the transmit queue; takes 128 times 11 recessive bits */
    }
    if ((alerts & TWAI_ALERT_BUS_RECOVERED) != 0) {
        is_off = twai_start() != ESP_OK; /* the driver stops after a recovery */
    }
    if (!is_off && dahl_node_tick(&node, clock_us(), &out)) {
        send(&out);
    }
}

/* SPDX-License-Identifier: MIT */
#include <esp_idf_version.h>
#if ESP_IDF_VERSION < ESP_IDF_VERSION_VAL(5, 5, 0)
#include <string.h>
#include <driver/twai.h>
#include "bus.h"

#define ID_SHIFT 21 /* of a standard id in the filter; its other bits are those of RTR and data */

static bool is_off, went_off;

int bus_start(uint32_t id, uint32_t mask)
{
    twai_general_config_t general = TWAI_GENERAL_CONFIG_DEFAULT(BUS_TX_PIN, BUS_RX_PIN, TWAI_MODE_NORMAL);
    const twai_timing_config_t timing = TWAI_TIMING_CONFIG_500KBITS();
    const twai_filter_config_t filter = {id << ID_SHIFT, ~(mask << ID_SHIFT), true}; /* 1 in its mask passes both values */
    general.tx_queue_len = general.rx_queue_len = BUS_QUEUE;
    general.alerts_enabled = TWAI_ALERT_BUS_OFF | TWAI_ALERT_BUS_RECOVERED;
    int code = twai_driver_install(&general, &timing, &filter);
    return code != ESP_OK ? code : twai_start();
}

bool bus_send(const dahl_can_frame_t *frame)
{
    twai_message_t message = {.identifier = frame->id, .data_length_code = frame->length};
    memcpy(message.data, frame->data, 8);
    return twai_transmit(&message, 0) == ESP_OK;
}

static void read_alerts(void)
{
    uint32_t alerts = 0;
    twai_read_alerts(&alerts, 0);
    if ((alerts & TWAI_ALERT_BUS_OFF) != 0) {
        is_off = went_off = true;
        twai_initiate_recovery(); /* drops the transmit queue */
    }
    if ((alerts & TWAI_ALERT_BUS_RECOVERED) != 0) {
        is_off = twai_start() != ESP_OK; /* the driver stops after a recovery */
    }
}

bool bus_receive(dahl_can_frame_t *frame)
{
    twai_message_t message;
    bool has_frame = twai_receive(&message, BUS_WAIT_TICKS) == ESP_OK;
    read_alerts();
    if (has_frame) {
        uint8_t length = message.data_length_code < 8 ? message.data_length_code : 8;
        *frame = (dahl_can_frame_t){.id = message.identifier, .length = length};
        frame->flags = (message.extd ? DAHL_CAN_FRAME_EXTENDED : 0) | (message.rtr ? DAHL_CAN_FRAME_REMOTE : 0);
        memcpy(frame->data, message.data, 8);
    }
    return has_frame;
}

bool bus_went_off(void)
{
    bool was = went_off;
    went_off = false;
    return was;
}

bool bus_is_on(void)
{
    return !is_off;
}
#endif

/* SPDX-License-Identifier: MIT */
/* The driver keeps the pointer of each frame that it sends. After a recovery from bus-off it sends the frames of its queue, whose
 * torques are then old. It therefore gets one frame at a time; the others wait in a queue of this file. */
#include <esp_idf_version.h>
#if ESP_IDF_VERSION >= ESP_IDF_VERSION_VAL(5, 5, 0)
#include <stdatomic.h>
#include <string.h>
#include <esp_twai.h>
#include <esp_twai_onchip.h>
#include <freertos/FreeRTOS.h>
#include <freertos/queue.h>
#include <freertos/task.h>
#include "bus.h"

static twai_node_handle_t controller;
static QueueHandle_t received;
static TaskHandle_t task;
static dahl_can_frame_t waiting[BUS_QUEUE];
static uint32_t first, count; /* in `waiting` */
static twai_frame_t frame_of_driver;
static uint8_t data_of_driver[8];
static atomic_bool is_sending, is_off, went_off; /* set by interrupts */

static bool on_received(twai_node_handle_t handle, const twai_rx_done_event_data_t *event, void *user_data)
{
    uint8_t data[8] = {0};
    twai_frame_t in = {.buffer = data, .buffer_len = sizeof data};
    BaseType_t is_woken = pdFALSE;
    (void)event;
    (void)user_data;
    if (twai_node_receive_from_isr(handle, &in) == ESP_OK) {
        dahl_can_frame_t frame = {.id = in.header.id, .length = (uint8_t)(in.header.dlc < 8 ? in.header.dlc : 8)};
        frame.flags = (in.header.ide ? DAHL_CAN_FRAME_EXTENDED : 0) | (in.header.rtr ? DAHL_CAN_FRAME_REMOTE : 0);
        memcpy(frame.data, data, 8);
        xQueueSendFromISR(received, &frame, &is_woken); /* a frame that has no place is lost, as on the bus */
        vTaskNotifyGiveFromISR(task, &is_woken);
    }
    return is_woken == pdTRUE;
}

static bool on_sent(twai_node_handle_t handle, const twai_tx_done_event_data_t *event, void *user_data)
{
    BaseType_t is_woken = pdFALSE;
    (void)handle;
    (void)event;
    (void)user_data;
    is_sending = false;
    vTaskNotifyGiveFromISR(task, &is_woken); /* for the next frame */
    return is_woken == pdTRUE;
}

static bool on_state(twai_node_handle_t handle, const twai_state_change_event_data_t *event, void *user_data)
{
    (void)handle;
    (void)user_data;
    if (event->new_sta == TWAI_ERROR_BUS_OFF) {
        is_off = true;
        went_off = true;
    } else if (event->old_sta == TWAI_ERROR_BUS_OFF) {
        is_off = false;
    }
    return false;
}

int bus_start(uint32_t id, uint32_t mask)
{
    const twai_onchip_node_config_t config = {
        .io_cfg = {BUS_TX_PIN, BUS_RX_PIN, GPIO_NUM_NC, GPIO_NUM_NC},
        .bit_timing = {.bitrate = 500000, .sp_permill = 800},
        .fail_retry_cnt = -1, /* until the frame is sent, or bus-off */
        .tx_queue_depth = 1,
    };
    const twai_event_callbacks_t callbacks = {.on_rx_done = on_received, .on_tx_done = on_sent, .on_state_change = on_state};
    const twai_mask_filter_config_t filter = {.id = id, .mask = mask, .no_fd = true};
    task = xTaskGetCurrentTaskHandle();
    received = xQueueCreate(BUS_QUEUE, sizeof(dahl_can_frame_t));
    int code = received != NULL ? twai_new_node_onchip(&config, &controller) : ESP_ERR_NO_MEM;
    if (code == ESP_OK) {
        code = twai_node_register_event_callbacks(controller, &callbacks, NULL);
    }
    if (code == ESP_OK) {
        code = twai_node_config_mask_filter(controller, 0, &filter);
    }
    return code != ESP_OK ? code : twai_node_enable(controller);
}

static void send_next(void)
{
    if (count == 0 || is_sending || is_off) {
        return;
    }
    const dahl_can_frame_t *next = &waiting[first];
    memcpy(data_of_driver, next->data, 8);
    frame_of_driver = (twai_frame_t){.header = {.id = next->id, .dlc = next->length}, .buffer = data_of_driver};
    frame_of_driver.buffer_len = next->length;
    is_sending = true; /* before the call: it may be sent before the call returns */
    if (twai_node_transmit(controller, &frame_of_driver, 0) != ESP_OK) {
        is_sending = false; /* try again later */
        return;
    }
    first = (first + 1) % BUS_QUEUE;
    count--;
}

bool bus_send(const dahl_can_frame_t *frame)
{
    if (count == BUS_QUEUE || is_off) {
        return false;
    }
    waiting[(first + count) % BUS_QUEUE] = *frame;
    count++;
    send_next();
    return true;
}

bool bus_receive(dahl_can_frame_t *frame)
{
    ulTaskNotifyTake(pdFALSE, BUS_WAIT_TICKS);
    send_next();
    return xQueueReceive(received, frame, 0) == pdTRUE;
}

bool bus_went_off(void)
{
    bool was = atomic_exchange(&went_off, false);
    if (was) {
        count = 0;
        is_sending = false;
        twai_node_recover(controller);
    }
    return was;
}

bool bus_is_on(void)
{
    return !is_off;
}
#endif

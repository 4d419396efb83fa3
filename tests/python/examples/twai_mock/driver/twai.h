/* SPDX-License-Identifier: MIT */
/* driver/twai.h of ESP-IDF v5, as far as examples/can_esp32_twai uses it. Its functions are pointers, which the test sets. */
#ifndef TWAI_H
#define TWAI_H

#include <esp_idf_version.h>
#if ESP_IDF_VERSION >= ESP_IDF_VERSION_VAL(5, 5, 0)
#error "ESP-IDF 5.5 deprecates driver/twai.h"
#endif

#include <stdbool.h>
#include <stdint.h>

typedef int esp_err_t;
typedef uint32_t TickType_t;

enum { ESP_OK = 0 };
enum { TWAI_MODE_NORMAL = 0 };
enum { TWAI_ALERT_BUS_RECOVERED = 0x40, TWAI_ALERT_BUS_OFF = 0x2000 };

typedef struct {
    int mode, tx_io, rx_io;
    uint32_t tx_queue_len, rx_queue_len, alerts_enabled;
} twai_general_config_t;

typedef struct {
    uint32_t bit_per_s;
} twai_timing_config_t;

typedef struct {
    uint32_t acceptance_code, acceptance_mask;
    bool single_filter;
} twai_filter_config_t;

typedef struct {
    uint32_t extd : 1, rtr : 1, reserved : 30;
    uint32_t identifier;
    uint8_t data_length_code;
    uint8_t data[8];
} twai_message_t;

#define TWAI_GENERAL_CONFIG_DEFAULT(tx, rx, op_mode) \
    {.mode = op_mode, .tx_io = tx, .rx_io = rx, .tx_queue_len = 5, .rx_queue_len = 5}
#define TWAI_TIMING_CONFIG_500KBITS() {500000}

extern esp_err_t (*twai_driver_install)(const twai_general_config_t *, const twai_timing_config_t *,
                                        const twai_filter_config_t *);
extern esp_err_t (*twai_start)(void);
extern esp_err_t (*twai_initiate_recovery)(void);
extern esp_err_t (*twai_receive)(twai_message_t *, TickType_t);
extern esp_err_t (*twai_transmit)(const twai_message_t *, TickType_t);
extern esp_err_t (*twai_read_alerts)(uint32_t *, TickType_t);

#endif

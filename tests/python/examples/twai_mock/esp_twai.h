/* SPDX-License-Identifier: MIT */
/* esp_twai.h and esp_twai_onchip.h of ESP-IDF 5.5 to 6.1, as far as examples/can_esp32_twai uses them. Their functions are
 * pointers, which the test sets. */
#ifndef ESP_TWAI_MOCK_H
#define ESP_TWAI_MOCK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef int esp_err_t;

enum { ESP_OK = 0, ESP_ERR_NO_MEM = 0x101 };
enum { GPIO_NUM_NC = -1 };

typedef enum { TWAI_ERROR_ACTIVE, TWAI_ERROR_WARNING, TWAI_ERROR_PASSIVE, TWAI_ERROR_BUS_OFF } twai_error_state_t;
typedef struct twai_node_base *twai_node_handle_t;

typedef struct {
    uint32_t id;
    uint16_t dlc;
    struct {
        uint32_t ide : 1, rtr : 1, fdf : 1, brs : 1, esi : 1;
    };
    uint64_t timestamp;
} twai_frame_header_t;

typedef struct {
    twai_frame_header_t header;
    uint8_t *buffer;
    size_t buffer_len;
    uint8_t tx_queue_priority;
} twai_frame_t;

typedef struct {
    struct {
        int tx, rx, quanta_clk_out, bus_off_indicator;
    } io_cfg;
    struct {
        uint32_t bitrate;
        uint16_t sp_permill, ssp_permill;
    } bit_timing;
    int8_t fail_retry_cnt;
    uint32_t tx_queue_depth;
} twai_onchip_node_config_t;

typedef struct {
    union {
        uint32_t id;
        struct {
            uint32_t *id_list, num_of_ids;
        };
    };
    uint32_t mask;
    struct {
        uint32_t is_ext : 1, no_classic : 1, no_fd : 1, dual_filter : 1;
    };
} twai_mask_filter_config_t;

typedef struct {
    bool is_tx_success;
    const twai_frame_t *done_tx_frame;
} twai_tx_done_event_data_t;

typedef struct {
    char unused;
} twai_rx_done_event_data_t;

typedef struct {
    twai_error_state_t old_sta, new_sta;
} twai_state_change_event_data_t;

typedef struct {
    bool (*on_tx_done)(twai_node_handle_t, const twai_tx_done_event_data_t *, void *);
    bool (*on_rx_done)(twai_node_handle_t, const twai_rx_done_event_data_t *, void *);
    bool (*on_state_change)(twai_node_handle_t, const twai_state_change_event_data_t *, void *);
} twai_event_callbacks_t;

extern esp_err_t (*twai_new_node_onchip)(const twai_onchip_node_config_t *, twai_node_handle_t *);
extern esp_err_t (*twai_node_register_event_callbacks)(twai_node_handle_t, const twai_event_callbacks_t *, void *);
extern esp_err_t (*twai_node_config_mask_filter)(twai_node_handle_t, uint8_t, const twai_mask_filter_config_t *);
extern esp_err_t (*twai_node_enable)(twai_node_handle_t);
extern esp_err_t (*twai_node_recover)(twai_node_handle_t);
extern esp_err_t (*twai_node_transmit)(twai_node_handle_t, const twai_frame_t *, int);
extern esp_err_t (*twai_node_receive_from_isr)(twai_node_handle_t, twai_frame_t *);

#endif

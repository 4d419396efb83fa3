/* SPDX-License-Identifier: MIT */
/* esp_timer.h, as far as examples/can_esp32_twai uses it; the test sets the function. */
#ifndef ESP_TIMER_H
#define ESP_TIMER_H

#include <stdint.h>

extern int64_t (*esp_timer_get_time)(void);

#endif

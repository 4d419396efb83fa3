/* SPDX-License-Identifier: MIT */
/* FreeRTOS of ESP-IDF 5.5, as far as examples/can_esp32_twai uses it. Its functions are pointers, which the test sets. */
#ifndef FREERTOS_MOCK_H
#define FREERTOS_MOCK_H

#include <stdint.h>

enum { pdFALSE = 0, pdTRUE = 1 };

typedef int BaseType_t;
typedef unsigned UBaseType_t;
typedef uint32_t TickType_t;
typedef void *QueueHandle_t;
typedef void *TaskHandle_t;

extern QueueHandle_t (*xQueueCreate)(UBaseType_t, UBaseType_t);
extern BaseType_t (*xQueueSendFromISR)(QueueHandle_t, const void *, BaseType_t *);
extern BaseType_t (*xQueueReceive)(QueueHandle_t, void *, TickType_t);
extern TaskHandle_t (*xTaskGetCurrentTaskHandle)(void);
extern uint32_t (*ulTaskNotifyTake)(BaseType_t, TickType_t);
extern void (*vTaskNotifyGiveFromISR)(TaskHandle_t, BaseType_t *);

#endif

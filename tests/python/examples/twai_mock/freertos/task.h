/* SPDX-License-Identifier: MIT */
#include <freertos/FreeRTOS.h>

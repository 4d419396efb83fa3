/* SPDX-License-Identifier: MIT */
#include <esp_twai.h>

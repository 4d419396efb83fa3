/* SPDX-License-Identifier: MIT */
/* Weak default for images that do not start SysTick. */
#include "cortex_m.h"

void __attribute__((weak)) cortex_tick(void)
{
}

/* SPDX-License-Identifier: MIT */
/* An image that starts no SysTick never comes here. */
#include "cortex_m.h"

void cortex_tick(void)
{
}

/* SPDX-License-Identifier: MIT */
/* An image that starts no SysTick never comes here; one that does has a function of its own in its place. */
#include "cortex_m.h"

void __attribute__((weak)) cortex_tick(void)
{
}

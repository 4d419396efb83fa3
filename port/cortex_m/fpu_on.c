/* SPDX-License-Identifier: MIT */
/* Enable coprocessors 10 and 11, the FPU. Before this, a float instruction is a fault. */
#include "cortex_m.h"

#define CPACR 0xE000ED88u

void core_init(void)
{
    CORTEX_REGISTER(CPACR) |= 0xFu << 20;
    __asm volatile("dsb\n isb" ::: "memory");
}

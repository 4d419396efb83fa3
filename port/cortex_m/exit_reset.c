/* SPDX-License-Identifier: MIT */
/* Firmware never ends: after main or a fault, reset the core. */
#include "cortex_m.h"

#define AIRCR CORTEX_REGISTER(0xE000ED0Cu)
#define RESET_REQUEST 0x05FA0004u

static void reset(void) __attribute__((noreturn));

static void reset(void)
{
    __asm volatile("dsb" ::: "memory");
    AIRCR = RESET_REQUEST;
    for (;;) {
    }
}

void cortex_exit(int status)
{
    (void)status;
    reset();
}

void cortex_fault(void)
{
    reset();
}

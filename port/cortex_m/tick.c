/* SPDX-License-Identifier: MIT */
/* Microseconds from SysTick: an interrupt counts milliseconds, and the counter gives the part of the present one. */
#include "cortex_m.h"

extern char core_mhz[]; /* its address is the value, from the board's linker script */

#define SYSTICK_CONTROL CORTEX_REGISTER(0xE000E010u)
#define SYSTICK_RELOAD CORTEX_REGISTER(0xE000E014u)
#define SYSTICK_VALUE CORTEX_REGISTER(0xE000E018u)
#define INTERRUPT_STATE CORTEX_REGISTER(0xE000ED04u)
#define SYSTICK_PENDING (1u << 26)
#define US_PER_MS 1000u
enum { CORE_CLOCK = 4, INTERRUPT = 2, ENABLE = 1 };

static volatile uint32_t milliseconds;

static uint32_t mhz(void)
{
    return (uint32_t)(uintptr_t)core_mhz;
}

void cortex_tick(void)
{
    milliseconds++;
}

void tick_start(void)
{
    SYSTICK_RELOAD = mhz() * US_PER_MS - 1u;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = CORE_CLOCK | INTERRUPT | ENABLE;
}

/* Keep the time monotonic: an emulator may reload the counter before it raises the interrupt. */
static uint32_t latest_of(uint32_t now)
{
    static uint32_t latest;
    if ((int32_t)(now - latest) > 0) {
        latest = now;
    }
    return latest;
}

/* Read again if an interrupt occurred, so that both parts are of the same millisecond. If an interrupt is pending, the counter
 * has been reloaded, so add its millisecond. */
uint32_t tick_now_us(void)
{
    uint32_t whole, left, pending, reload = mhz() * US_PER_MS - 1u;
    do {
        whole = milliseconds;
        left = SYSTICK_VALUE;
        pending = INTERRUPT_STATE & SYSTICK_PENDING;
    } while (whole != milliseconds);
    whole += pending != 0 && left > reload / 2u;
    return latest_of(whole * US_PER_MS + (reload - left) / mhz());
}

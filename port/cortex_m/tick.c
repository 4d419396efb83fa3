/* SPDX-License-Identifier: MIT */
/* Microseconds from SysTick: an interrupt each millisecond counts those, the counter says how far the next one is. */
#include "cortex_m.h"

extern char core_mhz[]; /* its address is the number, from the board's linker script */

#define SYSTICK_CONTROL CORTEX_REGISTER(0xE000E010u)
#define SYSTICK_RELOAD CORTEX_REGISTER(0xE000E014u)
#define SYSTICK_VALUE CORTEX_REGISTER(0xE000E018u)
#define INTERRUPT_STATE CORTEX_REGISTER(0xE000ED04u)
#define SYSTICK_PENDING (1u << 26)
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
    SYSTICK_RELOAD = mhz() * 1000u - 1u;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = CORE_CLOCK | INTERRUPT | ENABLE;
}

/* Never back: an emulator may show a new turn of the counter before its interrupt. */
static uint32_t later(uint32_t now)
{
    static uint32_t latest;
    if ((int32_t)(now - latest) > 0) {
        latest = now;
    }
    return latest;
}

/* Read again if an interrupt came between, so that both parts are of one millisecond. An interrupt that is due but not yet
 * taken has started the counter anew: without its millisecond the time would go back. */
uint32_t tick_now_us(void)
{
    uint32_t whole, left, pending, reload = mhz() * 1000u - 1u;
    do {
        whole = milliseconds;
        left = SYSTICK_VALUE;
        pending = INTERRUPT_STATE & SYSTICK_PENDING;
    } while (whole != milliseconds);
    whole += pending != 0 && left > reload / 2u;
    return later(whole * 1000u + (reload - left) / mhz());
}

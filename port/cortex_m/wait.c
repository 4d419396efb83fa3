/* SPDX-License-Identifier: MIT */
/*
 * Sleep without a handler: if interrupts are masked (PRIMASK), a pending one still ends WFI. The interrupt is enabled during
 * the sleep only. Other enabled interrupts, such as SysTick, are handled when the mask is cleared.
 */
#include "cortex_m.h"

#define SET_ENABLE 0xE000E100u
#define CLEAR_ENABLE 0xE000E180u
#define CLEAR_PENDING 0xE000E280u

void cortex_wait(uint32_t number, bool (*ready)(void))
{
    uint32_t offset = number / 32u * 4u, bit = 1u << (number % 32u);
    __asm volatile("cpsid i" ::: "memory");
    CORTEX_REGISTER(CLEAR_PENDING + offset) = bit;
    CORTEX_REGISTER(SET_ENABLE + offset) = bit;
    if (!ready()) {
        __asm volatile("dsb\n wfi" ::: "memory");
    }
    CORTEX_REGISTER(CLEAR_ENABLE + offset) = bit;
    __asm volatile("cpsie i" ::: "memory");
}

/* SPDX-License-Identifier: MIT */
/*
 * Start-up of each Cortex-M: initialise memory, call core_init (fpu_on.c or fpu_none.c), then main.
 * The compiler's predefined macros select the symbol built_for_CORE, and the board's linker script requires it.
 */
#include "cortex_m.h"

#if defined(__ARM_ARCH_6M__)
const char built_for_m0 = 1;
#elif defined(__ARM_ARCH_7M__)
const char built_for_m3 = 1;
#elif defined(__ARM_ARCH_7EM__) && (__ARM_FP & 8)
const char built_for_m7 = 1;
#elif defined(__ARM_ARCH_7EM__)
const char built_for_m4f = 1;
#elif defined(__ARM_ARCH_8M_MAIN__)
const char built_for_m33 = 1;
#else
#error "no board of port/cortex_m has this core"
#endif

extern uint32_t data_start[], data_end[], data_image[], bss_start[], bss_end[], stack_top[];

int main(void);
void reset_handler(void);

void reset_handler(void)
{
    for (uint32_t *to = data_start, *from = data_image; to < data_end; to++, from++) {
        *to = *from;
    }
    for (uint32_t *to = bss_start; to < bss_end; to++) {
        *to = 0;
    }
    core_init();
    cortex_exit(main());
}

static void fault(void)
{
    cortex_fault();
}

typedef void (*handler_t)(void);

/* Entries after the stack pointer: reset, NMI, HardFault .. UsageFault, SVC, debug, PendSV, SysTick. */
static const struct {
    uint32_t *stack;
    handler_t handlers[15];
} vectors __attribute__((section(".vectors"), used)) = {
    stack_top,
    {reset_handler, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, cortex_tick},
};

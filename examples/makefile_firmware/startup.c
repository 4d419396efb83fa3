/* SPDX-License-Identifier: MIT */
/* Start-up from reset to main, and the vector table with the tick. */
#include <stdint.h>

extern uint32_t data_start[], data_end[], data_image[], bss_start[], bss_end[], stack_top[];

int main(void);
void friction_interrupt(void);
void reset(void);

void reset(void)
{
    for (uint32_t *to = data_start, *from = data_image; to < data_end; to++, from++) {
        *to = *from;
    }
    for (uint32_t *to = bss_start; to < bss_end; to++) {
        *to = 0;
    }
    main();
    for (;;) {
    }
}

static void fault(void)
{
    for (;;) {
    }
}

typedef void (*handler_t)(void);

/* After the stack pointer: reset, NMI, HardFault to UsageFault, four reserved, SVC, debug, one reserved, PendSV, SysTick. */
static const struct {
    uint32_t *stack;
    handler_t handlers[15];
} vectors __attribute__((section(".vectors"), used)) = {
    stack_top,
    {reset, fault, fault, fault, fault, fault, 0, 0, 0, 0, fault, fault, 0, fault, friction_interrupt},
};

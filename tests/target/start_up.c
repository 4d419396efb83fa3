/* SPDX-License-Identifier: MIT */
/* Spoil data and bss, reset, and compare both with the image. The exit code is 1 if the start-up left a spoiled word. */
#include <stdint.h>

extern uint32_t data_start[], data_end[], data_image[], bss_start[], bss_end[], stack_top[];

void friction_interrupt(void); /* of examples/makefile_firmware */

void friction_interrupt(void) {}

enum { SYS_EXIT_EXTENDED = 0x20, EXITED = 0x20026 }; /* semihosting */
#define AIRCR (*(volatile uint32_t *)0xE000ED0Cu)
#define RESET_REQUEST 0x05FA0004u
#define SPOILED 0xA5A5A5A5u

volatile uint32_t initialized[] = {1, 2, 3}, zeroed[3]; /* so that both sections have words */

static void end(uint32_t code)
{
    const uint32_t block[] = {EXITED, code};
    register uint32_t r0 __asm("r0") = SYS_EXIT_EXTENDED;
    register const void *r1 __asm("r1") = block;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

static void spoil_and_reset(void)
{
    for (volatile uint32_t *word = data_start; word < bss_end; word++) {
        *word = SPOILED;
    }
    AIRCR = RESET_REQUEST;
    for (;;) {
    }
}

int main(void)
{
    volatile uint32_t *is_second_run = (volatile uint32_t *)((uintptr_t)stack_top - 1024); /* below the stack in use */
    uint32_t wrong = initialized[0] != 1 || zeroed[0] != 0;
    if (*is_second_run != SPOILED) {
        *is_second_run = SPOILED;
        spoil_and_reset();
    }
    for (uint32_t *word = data_start, *image = data_image; word < data_end; word++, image++) {
        wrong |= *word != *image;
    }
    for (uint32_t *word = bss_start; word < bss_end; word++) {
        wrong |= *word != 0;
    }
    end(wrong);
    return 0;
}

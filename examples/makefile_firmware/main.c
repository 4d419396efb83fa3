/* SPDX-License-Identifier: MIT */
/*
 * Friction of a shaft with a 14-bit encoder at 1 kHz, by SysTick. The encoder is made up here: it turns by 2 counts a tick,
 * forward for 50 ticks and back for 50. The main loop waits for the 100th and prints every tenth torque through the debugger.
 */
#include <stdint.h>
#include <stdio.h>

#include "dahl.h"

enum { MODULUS = 16384, TICKS = 100, CORE_HZ = 25000000, SYS_WRITE0 = 0x04, SYS_EXIT = 0x18, EXIT_APPLICATION = 0x20026 };

static const dahl_params_t params = {100.0f, 0.5f, 6.2831853f / MODULUS}; /* sigma0 N m/rad, Fc N m, rad/count */
static dahl_plan_t plan;
static dahl_state_t bearing; /* the interrupt's own */
static uint32_t before;      /* reading of the encoder, too */
static float torque[TICKS];  /* N m, until the last tick */
static volatile uint32_t ticks;

/* In a product: the counter of a timer in encoder mode, or an SPI transfer. */
static uint32_t encoder_read(void)
{
    uint32_t tick = ticks, half = TICKS / 2;
    return 2 * (tick < half ? tick + 1 : TICKS - 1 - tick);
}

void friction_interrupt(void)
{
    if (ticks == TICKS) {
        return;
    }
    uint32_t now = encoder_read();
    torque[ticks] = dahl_step_counts(&plan, &bearing, dahl_counts_between(before, now, MODULUS));
    before = now;
    ticks++;
}

static void start_systick(uint32_t period)
{
    volatile uint32_t *systick = (volatile uint32_t *)0xE000E010u; /* CTRL, LOAD, VAL */
    systick[1] = period - 1;
    systick[2] = 0;
    systick[0] = 7;
}

/* A call of the debugger, which QEMU answers; without one it would be a fault. */
static void debugger(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

static void print(uint32_t tick, float F)
{
    char line[40];
    snprintf(line, sizeof line, "tick %3lu  %ld nN m\n", (unsigned long)tick, (long)(F * 1e9f));
    debugger(SYS_WRITE0, line);
}

int main(void)
{
    if (dahl_prepare(&plan, &params) != DAHL_OK) {
        return 1;
    }
    start_systick(CORE_HZ / 1000);
    while (ticks < TICKS) {
        __asm volatile("wfi");
    }
    for (uint32_t tick = 10; tick <= TICKS; tick += 10) {
        print(tick, torque[tick - 1]);
    }
    debugger(SYS_EXIT, (const void *)EXIT_APPLICATION);
    return 0;
}

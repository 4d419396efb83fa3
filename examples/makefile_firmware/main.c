/* SPDX-License-Identifier: MIT */
/*
 * Friction of a shaft with a 14-bit encoder at 1 kHz, by SysTick, on a core without an FPU: from the reading to a torque in whole
 * nN m there is no float. The encoder is made up here: it turns by 2 counts a tick, forward for 50 ticks and back for 50. The
 * main loop waits for the 100th and prints every tenth torque through the debugger.
 */
#include <stdint.h>
#include <stdio.h>

#include "dahl.h"
#include "dahl_encoder.h"

enum { FC_UNITS = 500000000 }; /* Fc in nN m */
enum { MODULUS = 16384, TICKS = 100, CORE_HZ = 25000000, SYS_WRITE0 = 0x04, SYS_EXIT = 0x18, EXIT_APPLICATION = 0x20026 };

static const dahl_params_t params = {100.0f, 0.5f, 6.2831853f / MODULUS}; /* sigma0 N m/rad, Fc N m, rad/count */
static dahl_plan_t plan;
static dahl_state_t bearing; /* the interrupt's own, and so is the encoder */
static dahl_encoder_t encoder;
static int32_t torque[TICKS]; /* nN m, until the last tick */
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
    int32_t ratio = dahl_step_counts_q30(&plan, &bearing, dahl_encoder_move(&encoder, encoder_read()));
    torque[ticks] = dahl_to_units(ratio, FC_UNITS); /* a drive adds the torque that its controller asks for */
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

static void print(uint32_t tick, int32_t F)
{
    char line[40];
    snprintf(line, sizeof line, "tick %3lu  %ld nN m\n", (unsigned long)tick, (long)F);
    debugger(SYS_WRITE0, line);
}

int main(void)
{
    if (dahl_prepare(&plan, &params) != DAHL_OK || dahl_encoder_init(&encoder, MODULUS, +1, 0) != DAHL_OK) {
        return 1;
    }
    dahl_encoder_home(&encoder, 0); /* where it stands before the first tick */
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

/* SPDX-License-Identifier: MIT */
/*
 * Friction of a shaft with a 14-bit encoder at 1 kHz, by SysTick, on a core without an FPU. No step from the reading to the
 * torque in nN m uses a float. The encoder is simulated: it turns by 2 counts a tick, 50 ticks forward and 50 back. The main
 * loop waits for the last tick and prints each tenth torque through the debugger.
 */
#include <stdint.h>
#include <stdio.h>

#include "dahl.h"
#include "dahl_encoder.h"

enum { FC_UNITS = 500000000 }; /* Fc in nN m */
enum { MODULUS = 16384, TICKS = 100, TICK_HZ = 1000, CORE_HZ = 25000000, };
enum { SYS_WRITE0 = 0x04, SYS_EXIT = 0x18, EXIT_APPLICATION = 0x20026 }; /* semihosting */

static const dahl_params_t params = {100.0f, 0.5f, 6.2831853f / MODULUS}; /* sigma0 N m/rad, Fc N m, rad/count */
static dahl_plan_t plan;
static dahl_state_t bearing; /* used by the interrupt only, as the encoder */
static dahl_encoder_t encoder;
static int32_t torque[TICKS]; /* nN m, of each tick */
static volatile uint32_t ticks;

/* In a product, read the counter of a timer in encoder mode, or an SPI encoder. */
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
    torque[ticks] = dahl_to_units(ratio, FC_UNITS); /* a drive adds the torque of its controller */
    ticks++;
}

static void start_systick(uint32_t period)
{
    volatile uint32_t *systick = (volatile uint32_t *)0xE000E010u; /* CTRL, LOAD, VAL */
    systick[1] = period - 1;
    systick[2] = 0;
    systick[0] = 7;
}

/* Call the debugger, which QEMU implements. Without a debugger this is a fault. */
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
    dahl_encoder_home(&encoder, 0); /* the count before the first tick is 0 */
    start_systick(CORE_HZ / TICK_HZ);
    while (ticks < TICKS) {
        __asm volatile("wfi");
    }
    for (uint32_t tick = 10; tick <= TICKS; tick += 10) {
        print(tick, torque[tick - 1]);
    }
    debugger(SYS_EXIT, (const void *)EXIT_APPLICATION);
    return 0;
}

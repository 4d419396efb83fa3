/* SPDX-License-Identifier: MIT */
/*
 * Friction of a shaft with an encoder of 10000 counts a turn, read from a 16-bit timer that wraps at 65536.
 * On a microcontroller, `timer` is a register such as TIM3->CNT, and friction_tick() runs at a constant rate. Here main() turns
 * the shaft forward over the wrap and back, and prints the torque of each tick.
 */
#include <stdio.h>

#include <dahl.h>
#include <dahl_encoder.h>

static volatile uint16_t timer = 65450;

static dahl_plan_t plan;
static dahl_state_t bearing;
static dahl_encoder_t encoder;

/* Returns 0, a code of dahl_prepare(), or 1: the encoder. */
static int friction_init(void)
{
    dahl_params_t params = {.sigma0 = 100.0f, .Fc = 0.5f, .theta_per_count = 6.2831853f / 10000};
    int code = dahl_prepare(&plan, &params);
    if (code == DAHL_OK && dahl_encoder_init(&encoder, 65536, +1, 100) != DAHL_OK) { /* at most 100 counts a tick */
        code = 1;
    }
    return code;
}

/* N m. */
static float friction_tick(void)
{
    return dahl_step_counts(&plan, &bearing, dahl_encoder_move(&encoder, timer));
}

int main(void)
{
    static const int moves[] = {0, 5, 90, 90, 90, 90, -1, -1, -10, -90};
    if (friction_init() != DAHL_OK) {
        return 1;
    }
    for (unsigned i = 0; i < sizeof moves / sizeof moves[0]; i++) {
        timer = (uint16_t)(timer + moves[i]);
        float torque = friction_tick();
        printf("timer %5u   %+.4f N m\n", (unsigned)timer, (double)torque);
    }
    timer = 0; /* an index pulse resets the timer: a jump, and no motion */
    float torque = friction_tick();
    printf("timer %5u   %+.4f N m   jumps %u\n", (unsigned)timer, (double)torque, (unsigned)encoder.jumps);
    return 0;
}

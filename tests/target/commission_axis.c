/* SPDX-License-Identifier: MIT */
/*
 * examples/commission_axis on a core, against a shaft that this image simulates: rotor, Dahl's friction by an implicit step,
 * gravity, an encoder of 16 bits, a delay of one tick. The truth must be in each interval. Then the compensator runs: a push
 * must come to rest (at most 5 mrad/s), and a hand with 0.6 of Fc must move the axis, which friction alone would hold.
 */
#include <stdio.h>

#include "axis.h"

#define PERIOD 1e-3f
#define COUNT (6.2831853f / 65536)
#define INERTIA 0.002f
#define FC 0.5f
#define SIGMA0 100.0f
#define GRAVITY 0.1f
#define TICKS 45000
#define SUBSTEPS 10

static struct {
    float theta, speed, friction, acting;
    int32_t counts;
} shaft;

static axis_t axis;

static float absolute(float x)
{
    return x < 0 ? -x : x;
}

/* Return the counts of a tick under the torque of the last one and that of a hand. */
static int32_t move_shaft(float torque, float hand)
{
    const float dt = PERIOD / SUBSTEPS;
    int32_t before = shaft.counts;
    for (int k = 0; k < SUBSTEPS; k++) {
        float moved = shaft.speed * dt;
        shaft.friction = (shaft.friction + SIGMA0 * moved) / (1 + SIGMA0 * absolute(moved) / FC);
        shaft.theta += moved;
        shaft.speed += dt * (shaft.acting + hand - shaft.friction - GRAVITY) / INERTIA;
    }
    shaft.acting = torque;
    shaft.counts = (int32_t)(shaft.theta / COUNT + 10000) - 10000;
    return shaft.counts - before;
}

/* Run for `ticks` under the torque of a hand. Return the way in rad. */
static float run(int ticks, float hand)
{
    static int32_t dcounts;
    float start = shaft.theta;
    for (int k = 0; k < ticks; k++) {
        dcounts = move_shaft(axis_tick(&axis, dcounts, 1), hand);
    }
    return shaft.theta - start;
}

static int is_within(const char *name, dahl_commission_range_t range, float truth)
{
    printf("%s %d %d %d ppm of the truth\n", name, (int)(1e6f * range.least / truth), (int)(1e6f * range.best / truth),
           (int)(1e6f * range.most / truth));
    return range.least <= truth && truth <= range.most;
}

int main(void)
{
    const dahl_commission_config_t config = {.period = PERIOD, .theta_per_count = COUNT, .inertia = 1.2f * INERTIA,
                                             .travel = 0.35f, .angle_limit = 0.7f, .speed_limit = 10, .torque_limit = 5};
    int ticks = 0;
    if (axis_start(&axis, &config, 35) != DAHL_COMMISSION_OK) {
        return 1;
    }
    for (; ticks < TICKS && axis.command.stage < DAHL_COMMISSION_DONE; ticks++) {
        run(1, 0);
    }
    const dahl_commission_result_t *result = &axis.commission.result;
    printf("stage %d, refusal %d, %d ticks\n", axis.command.stage, axis.command.refusal, ticks);
    int is_true = is_within("Fc", result->Fc, FC) && is_within("length", result->length, FC / SIGMA0)
                  && is_within("sigma0", result->sigma0, SIGMA0) && is_within("inertia", result->inertia, INERTIA)
                  && is_within("delay", result->delay, PERIOD);
    is_true = is_true && absolute(dahl_commission_load(&axis.commission, 0) - GRAVITY) <= result->load_error;
    run(1000, 0); /* the compensator fades in */
    float pushed = run(20, 2 * FC);
    run(1500, 0);
    float drift = run(500, 0), led = run(1000, 0.6f * FC);
    printf("pushed %d, drift %d, led %d urad\n", (int)(1e6f * pushed), (int)(1e6f * drift), (int)(1e6f * led));
    return !(axis.is_compensating && is_true && pushed > 0.002f && absolute(drift) < 2.5e-3f && led > 0.05f);
}

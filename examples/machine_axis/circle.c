/* SPDX-License-Identifier: MIT */
/*
 * Simulate two axes of a machine tool that travel a circle of 25 mm radius, each with a ball screw and the position loop of
 * ../position_loop. An axis reverses at two of the four quadrants. Its friction then turns round and leaves a mark.
 *
 *   circle FEED FRICTION LAW [FC [LENGTH [SECONDS]]]
 *
 * FEED is in m/min, FRICTION is dahl or lugre. LAW is none, reversal (the sign of the speed behind a low-pass of SECONDS), dahl
 * (the reference law) or observer (with the residual observer). The laws take FC in N m and LENGTH in um for the true ones.
 *
 * Each row of the output has the angle on the circle in degrees and the error of the radius in um. The true friction does not
 * use the library: it is LuGre's equation in steps of 12.5 us. Dahl's model is its case without Stribeck effect and damping.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../position_loop/position_loop.h"

#define TWO_PI 6.283185307179586
#define PERIOD 250e-6 /* s */
#define SUBSTEPS 20
#define ROWS_PER_DEGREE 10
#define RADIUS 25e-3            /* m */
#define LEAD 10e-3              /* m in a turn */
#define COUNTS_PER_TURN 1048576 /* 20 bits, +-1 count of noise */
#define INERTIA 0.005           /* kg m2: motor, screw and table */
#define FC 1.0                  /* N m */
#define PRESLIDING 15e-6        /* m */
#define VISCOUS 0.01            /* N m s/rad, known to the loop */
#define REVERSAL_S 0.045        /* s, the best for 1 m/min */

/* --- the plant ------------------------------------------------------------------------------------------------------ */

typedef struct {
    double Fc, breakaway;  /* N m */
    double stribeck_speed; /* rad/s */
    double sigma0, sigma1; /* N m/rad, N m s/rad */
} friction_t;

typedef struct {
    double angle, speed, bristle; /* rad, rad/s, rad */
    int64_t counts;
    uint32_t noise;
} axis_t;

/* Return LuGre's torque and move its bristle. */
static double rub(const friction_t *friction, axis_t *axis, double dt)
{
    double ratio = axis->speed / friction->stribeck_speed;
    double most = friction->Fc + (friction->breakaway - friction->Fc) * exp(-ratio * ratio);
    double rate = axis->speed - friction->sigma0 * fabs(axis->speed) / most * axis->bristle;
    axis->bristle += rate * dt;
    return friction->sigma0 * axis->bristle + friction->sigma1 * rate + VISCOUS * axis->speed;
}

static void advance(const friction_t *friction, axis_t *axis, double torque)
{
    const double dt = PERIOD / SUBSTEPS;
    for (int k = 0; k < SUBSTEPS; k++) {
        axis->speed += dt / INERTIA * (torque - rub(friction, axis, dt));
        axis->angle += dt * axis->speed;
    }
}

static int32_t read_encoder(axis_t *axis)
{
    axis->noise = axis->noise * 1664525u + 1013904223u;
    int64_t now = (int64_t)floor(axis->angle / TWO_PI * COUNTS_PER_TURN) + (int64_t)(axis->noise >> 16) % 3 - 1;
    int32_t dcounts = (int32_t)(now - axis->counts);
    axis->counts = now;
    return dcounts;
}

/* --- the circle ----------------------------------------------------------------------------------------------------- */

typedef struct {
    const char *name;
    double Fc, length, seconds; /* N m, m, s */
} law_t;

static int is(const char *name, const char *other)
{
    return strcmp(name, other) == 0;
}

static position_loop_params_t params_of(const law_t *law)
{
    float Fc = (float)law->Fc, length = (float)(law->length / LEAD * TWO_PI);
    float gain = is(law->name, "dahl") || is(law->name, "observer") ? 1.0f : 0.0f;
    position_loop_params_t params = {
        .compensator = {.friction = {Fc / length, Fc, (float)(TWO_PI / COUNTS_PER_TURN)},
                        .law = DAHL_COMPENSATOR_REFERENCE, .gain = gain, .limit = 2.0f, .slew = 1000.0f,
                        .period = (float)PERIOD, .noise = 1, .play = 4, .jump = 20000},
        .observer = {.inertia = (float)INERTIA, .corner = 15.0f, .limit = Fc / 2, .speed_gain = 1.25f, .delay = 1},
        .position_gain = 60.0f, .integral_time = 0.016f, .drive_limit = 20.0f};
    return params;
}

typedef struct {
    position_loop_params_t params;
    position_loop_t loop;
    friction_t friction;
    axis_t axis;
    int64_t reference; /* counts */
    law_t law;
    double reversal;   /* N m, torque of the law of this name */
    double command;    /* N m, acts from the next tick on */
} drive_t;

static int start(drive_t *drive, const char *friction, const law_t *law)
{
    double sigma0 = FC / (PRESLIDING / LEAD * TWO_PI);
    memset(drive, 0, sizeof *drive);
    drive->friction = (friction_t){FC, FC, 1.0, sigma0, 0.0};
    if (is(friction, "lugre")) {
        drive->friction = (friction_t){FC, 1.3 * FC, 0.5, sigma0, 0.3 * sqrt(sigma0 * INERTIA)};
    }
    drive->law = *law;
    drive->params = params_of(law);
    int code = position_loop_init(&drive->loop, &drive->params);
    if (!is(law->name, "observer")) {
        memset(&drive->loop.residual_plan, 0, sizeof drive->loop.residual_plan); /* no observer */
    }
    return code;
}

/* One tick of an axis that must be at `way`, with the speed and acceleration of it. m, m/s, m/s2 */
static void tick(drive_t *drive, double way, double speed, double acceleration)
{
    const double rad = TWO_PI / LEAD;
    int32_t dcounts = read_encoder(&drive->axis);
    int64_t wanted = llround(way / LEAD * COUNTS_PER_TURN);
    position_loop_reference_t reference = {(int32_t)(wanted - drive->reference), (float)(speed * rad),
                                           (float)(acceleration * rad), (float)(VISCOUS * speed * rad)};
    drive->reference = wanted;
    advance(&drive->friction, &drive->axis, drive->command);
    drive->command = position_loop_tick(&drive->loop, &reference, dcounts, 1);
    if (is(drive->law.name, "reversal")) {
        drive->reversal += PERIOD / drive->law.seconds * (drive->law.Fc * ((speed > 0) - (speed < 0)) - drive->reversal);
        drive->command += drive->reversal;
    }
}

static double position(const drive_t *drive)
{
    return drive->axis.angle / TWO_PI * LEAD;
}

/* Print the error of the radius from 90 to 450 degrees. The first quarter is the run-up. */
static void travel(drive_t *x, drive_t *y, double feed)
{
    const double rise = 0.3, turn = feed / RADIUS; /* s, rad/s */
    double angle = 0.0;
    long row = 90 * ROWS_PER_DEGREE;
    for (long k = 0; row < 450 * ROWS_PER_DEGREE; k++) {
        double part = fmin((double)k * PERIOD / rise, 1.0), rate = turn * part, gain = part < 1.0 ? turn / rise : 0.0;
        double c = cos(angle), s = sin(angle);
        tick(x, RADIUS * (c - 1), -RADIUS * s * rate, -RADIUS * (c * rate * rate + s * gain));
        tick(y, RADIUS * s, RADIUS * c * rate, RADIUS * (-s * rate * rate + c * gain));
        if (angle * 360.0 / TWO_PI * ROWS_PER_DEGREE >= (double)row) {
            printf("%.1f %.4f\n", (double)row++ / ROWS_PER_DEGREE, 1e6 * (hypot(RADIUS + position(x), position(y)) - RADIUS));
        }
        angle += rate * PERIOD + 0.5 * gain * PERIOD * PERIOD;
    }
}

/* Return whether the first three words after the name are a feed, a friction and a law. */
static int are_known(int words, char **word)
{
    if (words < 4 || !(atof(word[1]) > 0)) {
        return 0;
    }
    int is_friction = is(word[2], "dahl") || is(word[2], "lugre");
    return is_friction && (is(word[3], "none") || is(word[3], "reversal") || is(word[3], "dahl") || is(word[3], "observer"));
}

int main(int words, char **word)
{
    static drive_t x, y;
    if (!are_known(words, word)) {
        fprintf(stderr, "usage: circle FEED dahl|lugre none|reversal|dahl|observer [FC [LENGTH [SECONDS]]]\n");
        return 2;
    }
    law_t law = {word[3], words > 4 ? atof(word[4]) : FC, words > 5 ? 1e-6 * atof(word[5]) : PRESLIDING,
                 words > 6 ? atof(word[6]) : REVERSAL_S};
    int code = start(&x, word[2], &law) != 0 ? 1 : start(&y, word[2], &law);
    if (code != 0) {
        fprintf(stderr, "circle: the library refuses these numbers\n");
        return 1;
    }
    y.axis.noise = 1; /* another encoder */
    travel(&x, &y, atof(word[1]) / 60);
    return 0;
}

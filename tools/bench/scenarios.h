/* SPDX-License-Identifier: MIT */
/*
 * The hard motions that every way is measured on, host and target alike: those of the tests, and three more. Parameters are
 * sigma0 = 100 N m/rad, Fc = 0.5 N m, a = 200/rad; what differs is the encoder, so the travel of one count.
 */
#ifndef SCENARIOS_H
#define SCENARIOS_H

#include "motions.h"

#define SCENARIO_SIGMA0 100.0f
#define SCENARIO_FC 0.5f

/* A turn at 32 samples a cycle, Q15; a quarter of it, and the rest by symmetry. */
static inline int32_t scenario_sine(uint32_t k)
{
    static const int32_t quarter[9] = {0, 6393, 12540, 18205, 23170, 27246, 30274, 32138, 32768};
    uint32_t in_half = k % 16u, in_quarter = in_half <= 8u ? in_half : 16u - in_half;
    return k % 32u < 16u ? quarter[in_quarter] : -quarter[in_quarter];
}

static inline int32_t scenario_position(uint32_t k, int32_t amplitude)
{
    return (amplitude * scenario_sine(k) + 16384) >> 15;
}

static inline int32_t sine_step(motion_t *m, int32_t amplitude)
{
    uint32_t k = m->tick++;
    return scenario_position(k + 1, amplitude) - scenario_position(k, amplitude);
}

/* a A = 20 on 12 bits, and a A = 1 on 16. */
static inline int32_t motion_sine_wide(motion_t *m)
{
    return sine_step(m, 65);
}

static inline int32_t motion_sine_narrow(motion_t *m)
{
    return sine_step(m, 52);
}

/* A shaft that moves less than a count in most samples: a count in 100, now forward, now back, seldom more. */
static inline int32_t motion_creep(motion_t *m)
{
    uint32_t r = motion_random(m), t = m->tick++;
    return t % 100u != 0 ? 0 : (r & 64u ? 1 : -1) * (r % 7u == 0 ? 3 : 1);
}

typedef struct {
    const char *name;
    int turn_bits; /* counts of a turn: 2^turn_bits */
    motion_fn next;
} scenario_t;

static const scenario_t scenarios[] = {
    {"sweep_12", 12, motion_sweep},      {"sweep_24", 24, motion_sweep}, {"two_one_24", 24, motion_two_one},
    {"dither_16", 16, motion_dither},    {"walk_20", 20, motion_walk},   {"sine_12", 12, motion_sine_wide},
    {"sine_16", 16, motion_sine_narrow}, {"creep_18", 18, motion_creep}, {"leap_14", 14, motion_leap},
    {"drift_30", 30, motion_two_one},
};

#define SCENARIOS (sizeof scenarios / sizeof scenarios[0])

static inline float scenario_theta(const scenario_t *s)
{
    float theta = 6.2831853f;
    for (int i = 0; i < s->turn_bits; i++) {
        theta *= 0.5f;
    }
    return theta;
}

#endif

/* SPDX-License-Identifier: MIT */
/* The hard motions, as counts per tick. Each is a function of the tick number and a seeded generator. */
#ifndef MOTIONS_H
#define MOTIONS_H

#include <stdint.h>

typedef struct {
    uint32_t tick;
    uint32_t random; /* xorshift32, must not be 0 */
} motion_t;

typedef int32_t (*motion_fn)(motion_t *);

#define MOTION_START {0, 2463534242u}

static inline uint32_t motion_random(motion_t *m)
{
    m->random ^= m->random << 13;
    m->random ^= m->random >> 17;
    m->random ^= m->random << 5;
    return m->random;
}

/* Sweeps of growing length, 1 count a tick. */
static inline int32_t motion_sweep(motion_t *m)
{
    uint32_t length = UINT32_C(1000) << ((m->tick >> 16) % 10u);
    return (m->tick++ / length) % 2u ? -1 : 1;
}

/* 40 ticks of 3 counts, then +-1 count. */
static inline int32_t motion_dither(motion_t *m)
{
    uint32_t t = m->tick++;
    return t % 100000u < 40u ? 3 : (t & 1u ? -1 : 1);
}

static inline int32_t motion_two_one(motion_t *m)
{
    return m->tick++ & 1u ? -1 : 2;
}

static inline int32_t motion_walk(motion_t *m)
{
    return (int32_t)(motion_random(m) % 17u) - 8;
}

/* Any int32_t, INT32_MIN included. */
static inline int32_t motion_leap(motion_t *m)
{
    uint32_t r = motion_random(m);
    return m->tick++ % 64u == 0 ? INT32_MIN : (int32_t)(r >> (r & 31u)) * (r & 64u ? -1 : 1);
}

static const struct {
    const char *name;
    motion_fn next;
} motions[] = {
    {"sweep", motion_sweep}, {"dither", motion_dither}, {"two-one", motion_two_one},
    {"walk", motion_walk},   {"leap", motion_leap},
};

#define MOTIONS (sizeof motions / sizeof motions[0])

#endif

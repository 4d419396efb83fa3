/* SPDX-License-Identifier: MIT */
/* Loads, as tick by tick they come, in Q30. */
#ifndef LOADS_H
#define LOADS_H

#include <math.h>

#include "motions.h"

#define ONE ((uint32_t)1 << 30)

typedef uint32_t (*load_fn)(motion_t *);

static inline uint32_t load_steady(motion_t *m)
{
    (void)m;
    return ONE;
}

/* 1 and a unit less: each growth is the smallest that there is. */
static inline uint32_t load_wobble(motion_t *m)
{
    return ONE - (motion_random(m) & 1u);
}

static inline uint32_t load_noise(motion_t *m)
{
    return ONE - (motion_random(m) >> 4);
}

static inline uint32_t load_any(motion_t *m)
{
    return motion_random(m) >> 1 >> (motion_random(m) & 31u);
}

/* The same at the end of the range. */
static inline uint32_t load_top(motion_t *m)
{
    return 0x7fffffffu - (motion_random(m) & 1u);
}

static inline uint32_t load_wave(motion_t *m)
{
    return (uint32_t)(ONE + 0x3fff0000 * sin(1e-3 * m->tick++));
}

static const struct {
    const char *name;
    load_fn next;
    uint32_t most;
} loads[] = {{"steady", load_steady, ONE},  {"wobble", load_wobble, ONE},     {"noise", load_noise, ONE},
             {"any", load_any, 0x7fffffff}, {"top", load_top, 0x7fffffff}, {"wave", load_wave, 0x7fffffff}};
#define LOADS (sizeof loads / sizeof loads[0])

#endif

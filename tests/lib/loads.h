/* SPDX-License-Identifier: MIT */
/* Loads per tick in Q30; `most` is the largest one. */
#ifndef LOADS_H
#define LOADS_H

#include <math.h>

#include "motions.h"

typedef uint32_t (*load_fn)(motion_t *);

static inline uint32_t load_steady(motion_t *m)
{
    (void)m;
    return UINT32_C(1) << 30;
}

/* 1, or one unit less: the load grows by the least step. */
static inline uint32_t load_wobble(motion_t *m)
{
    return (UINT32_C(1) << 30) - (motion_random(m) & 1u);
}

static inline uint32_t load_noise(motion_t *m)
{
    return (UINT32_C(1) << 30) - (motion_random(m) >> 4);
}

static inline uint32_t load_any(motion_t *m)
{
    return motion_random(m) >> 1 >> (motion_random(m) & 31u);
}

/* At the end of the range and beyond it. */
static inline uint32_t load_top(motion_t *m)
{
    uint32_t r = motion_random(m);
    return r % 4 == 0 ? 0x80000000u | r : 0x7fffffffu - (r & 1u);
}

static inline uint32_t load_wave(motion_t *m)
{
    return (uint32_t)((1 << 30) + 0x3fff0000 * sin(1e-3 * m->tick++));
}

static const struct {
    const char *name;
    load_fn next;
    uint32_t most;
} loads[] = {{"steady", load_steady, 1u << 30}, {"wobble", load_wobble, 1u << 30},  {"noise", load_noise, 1u << 30},
             {"any", load_any, 0x7fffffff},     {"top", load_top, UINT32_MAX}, {"wave", load_wave, 0x7fffffff}};
#define LOADS (sizeof loads / sizeof loads[0])

#endif

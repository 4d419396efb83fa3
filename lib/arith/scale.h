/* SPDX-License-Identifier: MIT */
/** Gain, ramp and limit of a torque, for the node and the compensator. No 64-bit product: small cores have none. */
#ifndef DAHL_SCALE_H
#define DAHL_SCALE_H

#include <stdint.h>

static inline uint32_t dahl_least(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

static inline uint32_t dahl_magnitude(int32_t x)
{
    return x < 0 ? 0u - (uint32_t)x : (uint32_t)x;
}

/** Return x factor 2^-16, rounded down, for a factor of at most 2^16. */
static inline int32_t dahl_scale_q16(int32_t x, uint32_t factor_q16)
{
    uint32_t low = (uint32_t)x & 0xffffu;
    return (int32_t)((uint32_t)(x >> 16) * factor_q16 + (low * factor_q16 >> 16));
}

/** Return the value nearest to `wanted` that differs from `now` by at most `step`. */
static inline int32_t dahl_approach(int32_t now, int32_t wanted, uint32_t step)
{
    if (wanted > now) {
        return (int32_t)((uint32_t)now + dahl_least((uint32_t)wanted - (uint32_t)now, step));
    }
    return (int32_t)((uint32_t)now - dahl_least((uint32_t)now - (uint32_t)wanted, step));
}

/** Return the value nearest to x within -most .. most. */
static inline int32_t dahl_limit(int32_t x, int32_t most)
{
    int32_t below = x < most ? x : most;
    return below > -most ? below : -most;
}

#endif

/* SPDX-License-Identifier: MIT */
/** Gain, ramp and limit of a torque. On cores that lack a 64-bit product, none is needed. */
#ifndef DAHL_SCALE_H
#define DAHL_SCALE_H

#include <stdint.h>

#include "core.h"

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

/**
 * Return x factor 2^-30, a half rounded up, for a factor of -2^30 .. 2^30 and a result that fits.
 *
 * ARMv6-M lacks a 64-bit product. x = x1:x0 is split above its low 16 bits and factor = f1:f0 above its low 15, so that
 * no sum of the four products overflows:
 * @verbatim
 *     x factor 2^-30 = 2 x1 f1 + (x1 f0 + (x0 f1 + x0 f0 2^-15) / 2) 2^-14
 * @endverbatim
 */
static inline int32_t dahl_scale_q30(int32_t x, int32_t factor_q30)
{
#if DAHL_V6M
    const int32_t x1 = x >> 16, x0 = (int32_t)((uint32_t)x & 0xffffu);
    const int32_t f1 = factor_q30 >> 15, f0 = (int32_t)((uint32_t)factor_q30 & 0x7fffu);
    const int32_t middle = x1 * f0 + ((x0 * f1 + (x0 * f0 >> 15)) >> 1);
    return (int32_t)(2 * (uint32_t)x1 * (uint32_t)f1 + (uint32_t)(((middle >> 13) + 1) >> 1));
#else
    return (int32_t)(((int64_t)x * factor_q30 + (INT32_C(1) << 29)) >> 30);
#endif
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

/* SPDX-License-Identifier: MIT */
/** Scale and limit a torque in Q30, without a 64-bit product: small cores have none. */
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

/** Return x factor 2^-16, truncated. x <= 2^31 and factor <= 3/2 2^16, so the result is below 2^32. */
static inline uint32_t dahl_scale_q16(uint32_t x, uint32_t factor_q16)
{
    uint32_t high = x >> 16, low = x & 0xffffu;
    return high * factor_q16 + low * (factor_q16 >> 16) + (low * (factor_q16 & 0xffffu) >> 16);
}

/** Return x times the factor, rounded towards 0, within +-limit. */
static inline int32_t dahl_scale_and_limit(int32_t x, uint32_t factor_q16, int32_t limit)
{
    int32_t magnitude = (int32_t)dahl_least(dahl_scale_q16(dahl_magnitude(x), factor_q16), (uint32_t)limit);
    return x < 0 ? -magnitude : magnitude;
}

#endif

/* SPDX-License-Identifier: MIT */
/* Leading zeros of x, 0 < x < 2^32, private: one instruction where the compiler knows it, a search elsewhere. */
#ifndef DAHL_BITS_H
#define DAHL_BITS_H

#include <stdint.h>

static inline int32_t dahl_leading_zeros_search(uint32_t x)
{
    int32_t zeros = 0;
    for (int32_t width = 16; width != 0; width >>= 1) {
        if ((x >> (32 - width)) == 0) {
            x <<= width;
            zeros += width;
        }
    }
    return zeros;
}

#if defined(__GNUC__) && !defined(__ARM_ARCH_6M__)
#define dahl_leading_zeros(x) __builtin_clz(x)
#else
#define dahl_leading_zeros(x) dahl_leading_zeros_search(x)
#endif

#endif

/* SPDX-License-Identifier: MIT */
/* What a compiler can do better than plain C, private; each has a plain form of the same result. */
#ifndef DAHL_BITS_H
#define DAHL_BITS_H

#include <stdint.h>

/* Leading zeros of x, 0 < x < 2^32. */
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

/* Keeps a 32-bit factor from being widened before a 32 x 32 -> 64 bit product, which then would be a 64 x 64 bit one. */
#if defined(__GNUC__)
#define DAHL_KEEP_32(x) __asm__("" : "+r"(x))
#else
#define DAHL_KEEP_32(x) ((void)(x))
#endif

#endif

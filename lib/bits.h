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

/* The bits of a float and back, without touching its value: safe for NaN and under every floating-point flag. */
#if defined(__GNUC__)
#define dahl_copy_word(to, from) ((void)__builtin_memcpy((to), (from), 4))
#else
static inline void dahl_copy_word(void *to, const void *from)
{
    for (int i = 0; i < 4; i++) {
        ((unsigned char *)to)[i] = ((const unsigned char *)from)[i];
    }
}
#endif

static inline uint32_t dahl_bits_of(float x)
{
    uint32_t bits;
    dahl_copy_word(&bits, &x);
    return bits;
}

static inline float dahl_float_of(uint32_t bits)
{
    float x;
    dahl_copy_word(&x, &bits);
    return x;
}

#if defined(__GNUC__)
#define DAHL_LIKELY(condition) __builtin_expect((condition), 1)
#else
#define DAHL_LIKELY(condition) (condition)
#endif

/* Keeps x as the 32-bit value that it is: not widened before a 32 x 32 -> 64 bit product, not taken apart again. */
#if defined(__GNUC__)
#define DAHL_KEEP_32(x) __asm__("" : "+r"(x))
#else
#define DAHL_KEEP_32(x) ((void)(x))
#endif

#endif

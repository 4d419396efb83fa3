/* SPDX-License-Identifier: MIT */
/* What a compiler can do better than plain C, private; each has a plain form of the same result. */
#ifndef DAHL_COMPILER_H
#define DAHL_COMPILER_H

#include <stdint.h>

/* ARMv6-M and ARMv8-M Baseline: products of 32 bits only, no count of leading zeros, eight registers for most instructions. */
#if defined(__GNUC__) && (defined(__ARM_ARCH_6M__) || defined(__ARM_ARCH_8M_BASE__))
#define DAHL_V6M 1
#else
#define DAHL_V6M 0
#endif

/* Leading zeros of x, 0 < x < 2^32; and of x >= 2^30. */
#if defined(__GNUC__) && !DAHL_V6M
#define dahl_leading_zeros(x) ((uint32_t)__builtin_clz(x))
#define dahl_leading_zero(x) dahl_leading_zeros(x)
#else
static inline uint32_t dahl_leading_zero(uint32_t x)
{
    return ~x >> 31;
}

static inline uint32_t dahl_leading_zeros(uint32_t x)
{
    uint32_t zeros = 0;
    if (x >> 16 == 0) {
        x <<= 16;
        zeros = 16;
    }
    if (x >> 24 == 0) {
        x <<= 8;
        zeros += 8;
    }
    if (x >> 28 == 0) {
        x <<= 4;
        zeros += 4;
    }
    if (x >> 30 == 0) {
        x <<= 2;
        zeros += 2;
    }
    return zeros + dahl_leading_zero(x);
}
#endif

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

/* The bits of a float and back, without touching its value: safe for NaN and under every floating-point flag. */
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
#define DAHL_SMALL __attribute__((cold)) /* made small rather than quick */
#define DAHL_OUT_OF_LINE __attribute__((noinline))
#define DAHL_ALWAYS_INLINE __attribute__((always_inline)) /* where the compiler, asked for small code, would call */
#define DAHL_KEEP(x) __asm__("" : "+r"(x)) /* keeps x as the value that it is: not widened, not put together otherwise */
#else
#define DAHL_LIKELY(condition) (condition)
#define DAHL_SMALL
#define DAHL_OUT_OF_LINE
#define DAHL_ALWAYS_INLINE
#define DAHL_KEEP(x) ((void)(x))
#endif

/* Out of line where registers are few, since one frame after the other takes less stack than one for all. */
#if DAHL_V6M
#define DAHL_APART DAHL_OUT_OF_LINE
#else
#define DAHL_APART
#endif

/* Both words of x in registers of any name, not moved to a pair. */
static inline uint64_t dahl_two_words(uint64_t x)
{
    uint32_t low = (uint32_t)x, high = (uint32_t)(x >> 32);
    DAHL_KEEP(low);
    DAHL_KEEP(high);
    return (uint64_t)high << 32 | low;
}

#endif

/* SPDX-License-Identifier: MIT */
/* What the library asks of a compiler and its core, private: checked here, once, when it is compiled. */
#ifndef DAHL_COMPILER_H
#define DAHL_COMPILER_H

#include <float.h>
#include <limits.h>
#include <stdint.h>

#include "core.h"

#if CHAR_BIT != 8
#error "dahl needs bytes of 8 bits"
#endif
#if FLT_RADIX != 2 || FLT_MANT_DIG != 24 || FLT_MAX_EXP != 128 || FLT_MIN_EXP != -125
#error "dahl needs float to be the 32-bit format of IEEE 754"
#endif
#if INT_MIN + INT_MAX != -1 || (-1 & 3) != 3
#error "dahl needs two's complement integers"
#endif
#if (-2 >> 1) != -1
#error "dahl needs a shift to the right that keeps the sign"
#endif
#if INT_MAX < 0x7fff
#error "dahl needs an int of 16 bits or more, as C does; with avr-gcc leave -mint8 out"
#endif
#if !defined(UINT32_MAX) || !defined(UINT64_MAX) || UINT32_MAX != 0xffffffff
#error "dahl needs uint32_t and uint64_t"
#endif

/* An array of this size does not compile where float and uint32_t differ in size. */
typedef char dahl_needs_a_float_of_4_bytes[sizeof(float) == 4 && sizeof(uint32_t) == 4 ? 1 : -1];

/* A C tick that lib/cores may have in assembly too. It is weak, so that the linker prefers the tick in assembly if the build has
 * assembled one. */
#if DAHL_V6M || DAHL_THUMB2
#define DAHL_WEAK_TICK __attribute__((weak))
#else
#define DAHL_WEAK_TICK
#endif

/* Optimization barrier: the compiler may assume nothing about the value of x. So it takes x for a word, and does not widen
 * it to 64 bits where x comes from several branches: 8 of the 105 instructions of a tick by angle. */
static inline uint32_t dahl_opaque(uint32_t x)
{
#if defined(__GNUC__)
    __asm__("" : "+r"(x));
#endif
    return x;
}

#if defined(__GNUC__)
#define DAHL_LIKELY(condition) __builtin_expect((condition), 1)
#define DAHL_COLD __attribute__((cold)) /* made small rather than quick */
#define DAHL_OUT_OF_LINE __attribute__((noinline))
#define DAHL_ALWAYS_INLINE __attribute__((always_inline)) /* where the compiler, asked for small code, would call */
#else
#define DAHL_LIKELY(condition) (condition)
#define DAHL_COLD
#define DAHL_OUT_OF_LINE
#define DAHL_ALWAYS_INLINE
#endif

#endif

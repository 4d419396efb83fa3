/* SPDX-License-Identifier: MIT */
/** Requirements on the compiler, checked at compile time, and its attributes. */
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

/** The size of this array is invalid if float or uint32_t does not have 4 bytes. */
typedef char dahl_needs_a_float_of_4_bytes[sizeof(float) == 4 && sizeof(uint32_t) == 4 ? 1 : -1];

/** A C tick that lib/cores may also have in assembly. It is weak, so the linker prefers the assembly tick. */
#if (DAHL_V6M || DAHL_THUMB2) && !defined(DAHL_WITHOUT_ASSEMBLY)
#define DAHL_WEAK_TICK __attribute__((weak))
#else
#define DAHL_WEAK_TICK
#endif

/** Optimization barrier: the compiler must not assume anything about x. It then keeps x in 32 bits even if x comes
 * from several branches, which saves 6 of the 98 instructions of a tick by angle in C. */
static inline uint32_t dahl_opaque(uint32_t x)
{
#if defined(__GNUC__)
    __asm__("" : "+r"(x));
#endif
    return x;
}

#if defined(__GNUC__)
#define DAHL_LIKELY(condition) __builtin_expect((condition), 1)
#define DAHL_COLD __attribute__((cold)) /* small rather than fast */
#define DAHL_OUT_OF_LINE __attribute__((noinline))
#define DAHL_ALWAYS_INLINE __attribute__((always_inline)) /* for compilers that would call it when they optimize for size */
#else
#define DAHL_LIKELY(condition) (condition)
#define DAHL_COLD
#define DAHL_OUT_OF_LINE
#define DAHL_ALWAYS_INLINE
#endif

#endif

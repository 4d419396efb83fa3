/* SPDX-License-Identifier: MIT */
/**
 * 32 x 32 -> 64 bit product for ARMv6-M and ARMv8-M Baseline, from four 16 x 16 bit products.
 *
 * In assembly, since compilers run out of low registers and need four times the instructions. x0 and x1 are the
 * lower and the upper half of x.
 */
#ifndef DAHL_MULTIPLY_V6M_H
#define DAHL_MULTIPLY_V6M_H

#include "compiler.h"

static inline DAHL_ALWAYS_INLINE uint64_t dahl_mul(uint32_t a, uint32_t b)
{
    uint32_t a1, b1, low;
    __asm__(".syntax unified\n\t"
            "lsrs %[a1], %[a], #16\n\tuxth %[a], %[a]\n\tlsrs %[b1], %[b], #16\n\tuxth %[b], %[b]\n\t"
            "movs %[low], %[a]\n\tmuls %[low], %[b], %[low]\n\t"                               /* a0 b0 */
            "muls %[b], %[a1], %[b]\n\tmuls %[a], %[b1], %[a]\n\tmuls %[b1], %[a1], %[b1]\n\t" /* a1 b0, a0 b1, a1 b1 */
            "lsls %[a1], %[b], #16\n\tlsrs %[b], %[b], #16\n\tadds %[low], %[low], %[a1]\n\tadcs %[b1], %[b1], %[b]\n\t"
            "lsls %[a1], %[a], #16\n\tlsrs %[a], %[a], #16\n\tadds %[low], %[low], %[a1]\n\tadcs %[b1], %[b1], %[a]"
            : [a] "+l"(a), [b] "+l"(b), [a1] "=&l"(a1), [b1] "=&l"(b1), [low] "=&l"(low)
            :
            : "cc");
    return (uint64_t)b1 << 32 | low;
}

/** Return the upper half of that product, which needs no sum that carries: a1 b0 + (a0 b0 >> 16) is below 2^32, and
 * so is a0 b1 plus the lower half of that. For the kernel; a tick by counts is shorter with dahl_mul(). */
static inline DAHL_ALWAYS_INLINE uint32_t dahl_upper_product(uint32_t a, uint32_t b)
{
    uint32_t a1, b1, low;
    __asm__(".syntax unified\n\t"
            "lsrs %[a1], %[a], #16\n\tuxth %[a], %[a]\n\tlsrs %[b1], %[b], #16\n\tuxth %[b], %[b]\n\t"
            "movs %[low], %[a]\n\tmuls %[low], %[b], %[low]\n\tlsrs %[low], %[low], #16\n\t"
            "muls %[b], %[a1], %[b]\n\tmuls %[a], %[b1], %[a]\n\tmuls %[a1], %[b1], %[a1]\n\t"
            "adds %[b], %[b], %[low]\n\tuxth %[low], %[b]\n\tadds %[a], %[a], %[low]\n\t"
            "lsrs %[b], %[b], #16\n\tlsrs %[a], %[a], #16\n\tadds %[a1], %[a1], %[b]\n\tadds %[a1], %[a1], %[a]"
            : [a] "+l"(a), [b] "+l"(b), [a1] "=&l"(a1), [b1] "=&l"(b1), [low] "=&l"(low)
            :
            : "cc");
    return a1;
}

#endif

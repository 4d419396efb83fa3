/* SPDX-License-Identifier: MIT */
/* The products of multiply.h from 16 x 16 bit ones, private, for ARMv6-M and ARMv8-M Baseline. In assembly, since compilers
 * run out of low registers here and put the parts on the stack: four times the instructions. Each statement needs seven of
 * the eight at most. Names: x0 and x1 are the lower and upper half of x. */
#ifndef DAHL_MULTIPLY_V6M_H
#define DAHL_MULTIPLY_V6M_H

#include "compiler.h"

/* In: a, b. Out: low, and the upper word in b1; a1, x: registers to use. */
#define DAHL_MULTIPLY_SPLIT                                                                                                 \
    ".syntax unified\n\t"                                                                                                   \
    "lsrs %[a1], %[a], #16\n\tuxth %[a], %[a]\n\tlsrs %[b1], %[b], #16\n\tuxth %[b], %[b]\n\t"                              \
    "movs %[x], %[a]\n\tmuls %[x], %[b], %[x]\n\t"                                        /* a0 b0 */                       \
    "muls %[b], %[a1], %[b]\n\tmuls %[a], %[b1], %[a]\n\tmuls %[b1], %[a1], %[b1]\n\t"    /* a1 b0, a0 b1, a1 b1 */

static inline DAHL_ALWAYS_INLINE uint64_t dahl_mul(uint32_t a, uint32_t b)
{
    uint32_t a1, b1, x;
    __asm__(DAHL_MULTIPLY_SPLIT
            "lsls %[a1], %[b], #16\n\tlsrs %[b], %[b], #16\n\tadds %[x], %[x], %[a1]\n\tadcs %[b1], %[b1], %[b]\n\t"
            "lsls %[a1], %[a], #16\n\tlsrs %[a], %[a], #16\n\tadds %[x], %[x], %[a1]\n\tadcs %[b1], %[b1], %[a]"
            : [a] "+l"(a), [b] "+l"(b), [a1] "=&l"(a1), [b1] "=&l"(b1), [x] "=&l"(x)
            :
            : "cc");
    return (uint64_t)b1 << 32 | x;
}

static inline DAHL_ALWAYS_INLINE uint32_t dahl_mulhi(uint32_t a, uint32_t b)
{
    return (uint32_t)(dahl_mul(a, b) >> 32);
}

typedef struct {
    uint32_t x0;
    uint32_t x1;
} dahl_factor_t;

static inline dahl_factor_t dahl_split(uint32_t a)
{
    dahl_factor_t f = {a & 0xffffu, a >> 16};
    DAHL_KEEP(f.x0); /* once for all products */
    DAHL_KEEP(f.x1);
    return f;
}

static inline uint32_t dahl_times(dahl_factor_t f, uint32_t b)
{
    uint32_t b1, x, y;
    __asm__(".syntax unified\n\t"
            "lsrs %[b1], %[b], #16\n\tuxth %[b], %[b]\n\t"
            "movs %[x], %[x0]\n\tmuls %[x], %[b], %[x]\n\tlsrs %[x], %[x], #16\n\t"
            "muls %[b], %[x1], %[b]\n\tadds %[b], %[b], %[x]\n\t" /* x1 b0 and the upper half of x0 b0: no carry out */
            "movs %[x], %[x0]\n\tmuls %[x], %[b1], %[x]\n\tmuls %[b1], %[x1], %[b1]\n\t"
            "uxth %[y], %[b]\n\tadds %[x], %[x], %[y]\n\tlsrs %[x], %[x], #16\n\tlsrs %[b], %[b], #16\n\t"
            "adds %[b1], %[b1], %[x]\n\tadds %[b1], %[b1], %[b]"
            : [b] "+l"(b), [b1] "=&l"(b1), [x] "=&l"(x), [y] "=&l"(y)
            : [x0] "l"(f.x0), [x1] "l"(f.x1)
            : "cc");
    return b1;
}

/* w + z g or w - z g in one; `part`, z times the lower word of g, goes first. A move of 0 leaves the carry as it is. */
#define DAHL_ACCUMULATE(add, add_carry, w0, w1, z, g, part)                                                                 \
    do {                                                                                                                    \
        uint32_t z1_, g1_;                                                                                                  \
        __asm__(".syntax unified\n\t"                                                                                       \
                "lsrs %[z1], %[z0], #16\n\tuxth %[z0], %[z0]\n\tlsrs %[g1], %[g0], #16\n\tuxth %[g0], %[g0]\n\t"            \
                add " %[low], %[low], %[x]\n\tmovs %[x], #0\n\t" add_carry " %[high], %[high], %[x]\n\t"                    \
                "movs %[x], %[z0]\n\tmuls %[x], %[g0], %[x]\n\t"                                                            \
                "muls %[g0], %[z1], %[g0]\n\tmuls %[z0], %[g1], %[z0]\n\tmuls %[g1], %[z1], %[g1]\n\t"                      \
                add " %[low], %[low], %[x]\n\t" add_carry " %[high], %[high], %[g1]\n\t"                                    \
                "lsls %[x], %[g0], #16\n\tlsrs %[g0], %[g0], #16\n\t"                                                       \
                add " %[low], %[low], %[x]\n\t" add_carry " %[high], %[high], %[g0]\n\t"                                    \
                "lsls %[x], %[z0], #16\n\tlsrs %[z0], %[z0], #16\n\t"                                                       \
                add " %[low], %[low], %[x]\n\t" add_carry " %[high], %[high], %[z0]"                                        \
                : [low] "+l"(w0), [high] "+l"(w1), [z0] "+l"(z), [g0] "+l"(g), [x] "+l"(part), [z1] "=&l"(z1_),             \
                  [g1] "=&l"(g1_)                                                                                           \
                :                                                                                                           \
                : "cc");                                                                                                    \
    } while (0)

static inline uint64_t dahl_add_product(uint64_t w, uint32_t z, uint32_t g_high, uint32_t g_low)
{
    DAHL_KEEP(z); /* made in a low register */
    uint32_t low = (uint32_t)w, high = (uint32_t)(w >> 32), part = dahl_mulhi(z, g_low);
    DAHL_ACCUMULATE("adds", "adcs", low, high, z, g_high, part);
    return (uint64_t)high << 32 | low;
}

static inline uint64_t dahl_subtract_product(uint64_t w, uint32_t z, uint32_t g_high, uint32_t g_low)
{
    uint32_t low = (uint32_t)w, high = (uint32_t)(w >> 32), part = dahl_mulhi(z, g_low);
    DAHL_ACCUMULATE("subs", "sbcs", low, high, z, g_high, part);
    return (uint64_t)high << 32 | low;
}

#endif

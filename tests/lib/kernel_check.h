/* SPDX-License-Identifier: MIT */
/* The kernel g(u) against long double expm1l, over floats first, first + stride, ... below last, as bit patterns. */
#ifndef KERNEL_CHECK_H
#define KERNEL_CHECK_H

#include <math.h>

#include "../../lib/kernel.h"

typedef struct {
    double error;
    float u;
} kernel_worst_t;

/* From u = 22.1 on dahl_step takes 1; where it begins to, between 22 - 2^-19 and 22, does not matter to the bound. */
static inline long double kernel_value(float u)
{
    if (u >= 22.1f) {
        return 1;
    }
    dahl_real_t r = dahl_real_of(dahl_bits_of(u));
    dahl_scaled_t scaled = {r.mantissa, -32 - r.exponent}, g = dahl_kernel(scaled);
    return ldexpl(g.mantissa, -32 - g.shift);
}

/* Subnormals are no angle for dahl_step: they count as zero motion, so the normal floats are what there is. */
static inline kernel_worst_t kernel_check(uint32_t first, uint32_t last, uint32_t stride)
{
    kernel_worst_t worst = {0, 0};
    for (uint64_t bits = first < DAHL_BITS_NORMAL ? DAHL_BITS_NORMAL : first; bits < last; bits += stride) {
        float u = dahl_float_of((uint32_t)bits);
        double error = (double)fabsl(kernel_value(u) / -expm1l(-(long double)u) - 1);
        if (error > worst.error) {
            worst.error = error;
            worst.u = u;
        }
    }
    return worst;
}

#endif

/* SPDX-License-Identifier: MIT */
/* The kernel g(u) against long double expm1l, over the angles first, first + stride, ... below last, as bit patterns. */
#ifndef KERNEL_CHECK_H
#define KERNEL_CHECK_H

#include <math.h>

#include "../../lib/model/kernel.h"

/* What g may have more than the exact value, in absolute terms: the two units of 2^-64 that bristle_update.h wants, and one
 * that is lost. */
#define KERNEL_UNITS 0x3p-64L

typedef struct {
    double error; /* relative, beyond KERNEL_UNITS */
    float u;
    long double before; /* g of the float before */
    int falls;          /* how often g was below that */
} kernel_worst_t;

/* A plan with a = 1, so that an angle is its own travel. */
static inline dahl_plan_t kernel_plan(void)
{
    dahl_plan_t plan;
    dahl_params_t p = {1.0f, 1.0f, 0.0f};
    return dahl_prepare(&plan, &p) == DAHL_OK ? plan : (dahl_plan_t){0}; /* whose kernel is far off */
}

static inline long double kernel_value(const dahl_plan_t *plan, uint32_t bits)
{
    dahl_q64_t g = dahl_kernel(dahl_travel(plan, bits));
    return ldexpl(g.hi, -32) + ldexpl(g.lo, -64);
}

/* Subnormals are no angle for dahl_step: they count as zero motion, so the normal floats are what there is. */
static inline void kernel_check(kernel_worst_t *worst, uint32_t first, uint32_t last, uint32_t stride)
{
    dahl_plan_t plan = kernel_plan();
    for (uint64_t bits = first < DAHL_BITS_NORMAL ? DAHL_BITS_NORMAL : first; bits < last; bits += stride) {
        float u = dahl_float_of((uint32_t)bits);
        long double g = kernel_value(&plan, (uint32_t)bits), exact = -expm1l(-(long double)u);
        double error = (double)((fabsl(g - exact) - KERNEL_UNITS) / exact);
        worst->falls += g < worst->before;
        worst->before = g;
        if (error > worst->error) {
            worst->error = error;
            worst->u = u;
        }
    }
}

#endif

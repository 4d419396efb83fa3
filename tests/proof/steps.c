/* SPDX-License-Identifier: MIT */
/*
 * The library's own inline and static functions as functions of numbers, for test_theorems.py: each of these is only a way to
 * call what the included file defines. A plan's entry comes as its two words.
 */
#include "encoder.c"
#include "gap.h"
#include "prepare.c"
#include "torque.h"
#include "wide.c"

int32_t q30(int64_t w)
{
    return (int32_t)dahl_q30((uint64_t)w);
}

int64_t forward(int64_t w, uint32_t g_high, uint32_t g_low)
{
    dahl_q64_t g = {g_high, g_low};
    return (int64_t)dahl_forward((uint64_t)w, g);
}

int64_t backward(int64_t w, uint32_t g_high, uint32_t g_low)
{
    dahl_q64_t g = {g_high, g_low};
    return (int64_t)dahl_backward((uint64_t)w, g);
}

/* The product that a step adds, by itself: z g, of which it keeps the upper 64 bits. */
uint64_t gap_times(uint32_t z, uint32_t g_high, uint32_t g_low)
{
    return dahl_add_product(0, z, g_high, g_low);
}

uint64_t upper_half(uint64_t a, uint64_t b)
{
    return dahl_mulhi64(a, b);
}

uint64_t joined(uint64_t c_x, uint64_t c_y)
{
    return join(c_x, c_y);
}

int32_t checked(uint32_t bits)
{
    return check(bits);
}

uint32_t torque_bits(uint32_t Fc_mantissa, uint32_t Fc_scale, int64_t w)
{
    dahl_plan_t plan;
    plan.Fc_mantissa = Fc_mantissa;
    plan.Fc_scale = Fc_scale;
    return dahl_bits_of(dahl_torque_here(&plan, (uint64_t)w));
}

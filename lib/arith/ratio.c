/* SPDX-License-Identifier: MIT */
/** Quotient of two numbers as a fraction. */
#include "fixed.h"

static int is_below(dahl_real_t x, dahl_real_t y)
{
    return x.exponent != y.exponent ? x.exponent < y.exponent : x.mantissa < y.mantissa;
}

uint64_t dahl_ratio_q62(dahl_real_t x, dahl_real_t y)
{
    int32_t shift = y.exponent - x.exponent;
    if (!is_below(x, y)) {
        return DAHL_ONE_Q62;
    }
    return shift > 63 ? 0 : ((dahl_quotient_q63(x.mantissa, y.mantissa) >> shift) + 1) >> 1;
}

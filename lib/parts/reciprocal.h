/* SPDX-License-Identifier: MIT */
/** Reciprocal of a limit that changes in each tick, without a division. */
#ifndef DAHL_RECIPROCAL_H
#define DAHL_RECIPROCAL_H

#include "../arith/fixed.h"

/** Return 1/x in Q31, for x in Q32 and 1/2 <= x < 1. Newton's method from the line 48/17 - 32/17 x, whose error is
 * at most 1/17; three steps square it to 2^-32. With the truncations the result is within 2 units. */
static inline uint32_t dahl_reciprocal_q31(uint32_t x)
{
    uint32_t y = 1768515945u - dahl_mulhi(x, 4042322161u); /* modulo 2, since the result is below 2 */
    for (int steps = 3; steps > 0; steps--) {
        y = (uint32_t)(dahl_mul(y, 0u - dahl_mulhi(x, y)) >> 31);
    }
    return y;
}

#endif

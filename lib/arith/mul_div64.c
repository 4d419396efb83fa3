/* SPDX-License-Identifier: MIT */
/** Wide products and quotients from narrow ones; smaller than the helper functions of the compiler. */
#include "fixed.h"

DAHL_COLD uint64_t dahl_mulhi64(uint64_t a, uint64_t b)
{
    uint32_t a1 = (uint32_t)(a >> 32), a0 = (uint32_t)a;
    uint32_t b1 = (uint32_t)(b >> 32), b0 = (uint32_t)b;
    uint64_t middle = dahl_mul(a1, b0) + dahl_mulhi(a0, b0);
    uint64_t other = dahl_mul(a0, b1) + (uint32_t)middle;
    return dahl_mul(a1, b1) + (middle >> 32) + (other >> 32);
}

/** One bit per turn. The lowest bits of both, which are 0 for floats, are ignored, so the remainder never
 * overflows. */
DAHL_COLD uint64_t dahl_quotient_q63(uint32_t numerator, uint32_t denominator)
{
    uint64_t quotient = 0;
    uint32_t rest = numerator >> 1;
    denominator >>= 1;
    for (int bit = 0; bit < 64; bit++) {
        quotient <<= 1;
        if (rest >= denominator) {
            rest -= denominator;
            quotient |= 1;
        }
        rest <<= 1;
    }
    return quotient;
}

uint64_t dahl_quotient(uint64_t numerator, uint64_t denominator, int bits)
{
    uint64_t quotient = 0;
    for (; bits > 0; bits--) {
        numerator <<= 1;
        quotient <<= 1;
        if (numerator >= denominator) {
            numerator -= denominator;
            quotient |= 1;
        }
    }
    return quotient;
}

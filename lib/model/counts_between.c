/* SPDX-License-Identifier: MIT */
/* Moves from the readings of a counter that wraps. */
#include "dahl.h"

/* reading modulo n > 0, by subtraction: cores without a division would call a helper. A reading below n takes no turn. */
static uint32_t modulo(uint32_t reading, uint32_t n)
{
    uint32_t multiple = n;
    while (multiple <= reading >> 1) {
        multiple <<= 1;
    }
    for (; multiple >= n && reading >= n; multiple >>= 1) {
        if (reading >= multiple) {
            reading -= multiple;
        }
    }
    return reading;
}

int32_t dahl_counts_between(uint32_t before, uint32_t now, uint32_t modulus)
{
    if (modulus == 0) {
        return (int32_t)(now - before);
    }
    before = modulo(before, modulus);
    now = modulo(now, modulus);
    uint32_t forward = now >= before ? now - before : now + (modulus - before);
    uint32_t backward = modulus - forward;
    return forward < backward ? (int32_t)forward : (int32_t)(0u - backward);
}

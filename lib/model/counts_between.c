/* SPDX-License-Identifier: MIT */
/* Moves from the readings of a counter that wraps. */
#include "dahl.h"

/* Only a reading that is not below the modulus costs a division. */
static uint32_t modulo(uint32_t reading, uint32_t modulus)
{
    return reading < modulus ? reading : reading % modulus;
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

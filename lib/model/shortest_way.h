/* SPDX-License-Identifier: MIT */
/* The shortest signed way between two readings of a counter that wraps, private. */
#ifndef DAHL_SHORTEST_WAY_H
#define DAHL_SHORTEST_WAY_H

#include <stdint.h>

/* Only a reading that is not below the modulus costs a division. */
static inline uint32_t dahl_modulo(uint32_t reading, uint32_t modulus)
{
    return reading < modulus ? reading : reading % modulus;
}

/* Half of the modulus is taken as negative; a modulus of 0 is 2^32. */
static inline int32_t dahl_shortest_way(uint32_t before, uint32_t now, uint32_t modulus)
{
    if (modulus == 0) {
        return (int32_t)(now - before);
    }
    before = dahl_modulo(before, modulus);
    now = dahl_modulo(now, modulus);
    uint32_t forward = now >= before ? now - before : now + (modulus - before);
    uint32_t backward = modulus - forward;
    return forward < backward ? (int32_t)forward : (int32_t)(0u - backward);
}

#endif

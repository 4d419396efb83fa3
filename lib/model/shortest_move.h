/* SPDX-License-Identifier: MIT */
/** Shortest signed move between two readings of a counter that wraps. */
#ifndef DAHL_SHORTEST_MOVE_H
#define DAHL_SHORTEST_MOVE_H

#include <stdint.h>

/** A division is needed only if the reading is not below the modulus. */
static inline uint32_t dahl_modulo(uint32_t reading, uint32_t modulus)
{
    return reading < modulus ? reading : reading % modulus;
}

/** Half of the modulus counts as negative; a modulus of 0 means 2^32. */
static inline int32_t dahl_shortest_move(uint32_t before, uint32_t now, uint32_t modulus)
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

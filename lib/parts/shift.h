/* SPDX-License-Identifier: MIT */
/** 64-bit shift by a variable from two words, without a helper function on small cores. */
#ifndef DAHL_SHIFT_H
#define DAHL_SHIFT_H

#include "../arith/compiler.h"

/** Return x 2^-bits, truncated, for any number of bits. */
static inline uint64_t dahl_shift_right(uint64_t x, uint32_t bits)
{
    uint32_t high = (uint32_t)(x >> 32), low = (uint32_t)x;
    if (bits >= 32) {
        low = high;
        high = 0;
        bits -= 32;
    }
    if (bits >= 32) {
        return 0;
    }
    low = low >> bits | high << 1 << (31 - bits);
    return (uint64_t)(high >> bits) << 32 | low;
}

#endif

/* SPDX-License-Identifier: MIT */
/* 32 x 32 bit products from 16 x 16 bit ones, private: for cores that multiply to 32 bits only. Half the instructions of
 * the compiler's 64-bit helper, and no call. */
#ifndef DAHL_MULTIPLY_16_H
#define DAHL_MULTIPLY_16_H

#include <stdint.h>

static inline uint64_t dahl_mul(uint32_t a, uint32_t b)
{
    uint32_t a0 = a & 0xffffu, a1 = a >> 16, b0 = b & 0xffffu, b1 = b >> 16;
    uint32_t low = a0 * b0;
    uint32_t first = a1 * b0 + (low >> 16);
    uint32_t second = a0 * b1 + (first & 0xffffu);
    uint32_t high = a1 * b1 + (first >> 16) + (second >> 16);
    return (uint64_t)high << 32 | (second << 16 | (low & 0xffffu));
}

static inline uint32_t dahl_mulhi(uint32_t a, uint32_t b)
{
    return (uint32_t)(dahl_mul(a, b) >> 32);
}

#endif

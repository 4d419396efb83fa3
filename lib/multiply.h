/* SPDX-License-Identifier: MIT */
/* The products of the library, private: 32 x 32 bits, whole or upper half. Cores without such an instruction (Cortex-M0)
 * take the same products from multiply_16.h; the bits are the same. */
#ifndef DAHL_MULTIPLY_H
#define DAHL_MULTIPLY_H

#include <stdint.h>

#if defined(__ARM_ARCH_6M__)
#include "multiply_16.h"
#else

static inline uint64_t dahl_mul(uint32_t a, uint32_t b)
{
    return (uint64_t)a * b;
}

static inline uint32_t dahl_mulhi(uint32_t a, uint32_t b)
{
    return (uint32_t)(((uint64_t)a * b) >> 32);
}

#endif

#endif

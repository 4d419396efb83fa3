/* SPDX-License-Identifier: MIT */
/* What the sums over parts read of one, private. */
#ifndef DAHL_PART_H
#define DAHL_PART_H

#include "../arith/fixed.h"
#include "dahl_parts.h"

/* Fc of a part, or the sum of Fc of its elements; a mantissa of 0 where its plan is all zeros. */
static inline dahl_real_t dahl_part_Fc(const dahl_part_t *part)
{
    const void *at = (const char *)part->plan + part->Fc;
    const uint32_t *words = (const uint32_t *)at;
    dahl_real_t Fc = {words[0], (int32_t)words[1]};
    return Fc;
}

/* Bits by which the sum of so many numbers may be longer than the longest of them. */
static inline uint32_t dahl_part_spare_bits(uint32_t count)
{
    return count == 0 ? 0 : 32 - dahl_leading_zeros(count);
}

#endif

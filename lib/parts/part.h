/* SPDX-License-Identifier: MIT */
/** Access to the Fc of a part. */
#ifndef DAHL_PART_H
#define DAHL_PART_H

#include "../arith/fixed.h"
#include "dahl_parts.h"

/** Return Fc of a part, or the sum of Fc of its elements. If its plan is all zeros, the mantissa is 0. */
static inline dahl_real_t dahl_part_Fc(const dahl_part_t *part)
{
    const void *at = (const char *)part->plan + part->Fc;
    const uint32_t *words = (const uint32_t *)at;
    dahl_real_t Fc = {words[0], (int32_t)words[1]};
    return Fc;
}

/** Return the number of bits by which a sum of `count` numbers can be longer than the longest of them. */
static inline uint32_t dahl_part_spare_bits(uint32_t count)
{
    return count == 0 ? 0 : 32 - dahl_leading_zeros(count);
}

#endif

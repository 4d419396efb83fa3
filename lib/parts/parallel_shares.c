/* SPDX-License-Identifier: MIT */
/**
 * Share of each part in the sum of Fc: share_k = Fc_k / sum of Fc, in Q31. The division is done once, so that a
 * tick only multiplies and adds.
 *
 * Each share is the difference of two rounded running sums. Its error is below 2^-31, and all shares together are
 * exactly 1. Shares are negative, since -2^31, which is the whole, fits in a word.
 */
#include "part.h"
#include "shift.h"

/** Return Fc in units of 2^(exponent + spare - 30). The sum of all Fc stays below 2^62. */
static DAHL_COLD uint64_t in_units(dahl_real_t Fc, int32_t exponent, uint32_t spare)
{
    return Fc.mantissa == 0 ? 0 : dahl_shift_right((uint64_t)Fc.mantissa << 30, (uint32_t)(exponent - Fc.exponent) + spare);
}

static DAHL_COLD int32_t largest_exponent(const dahl_part_t *parts, uint32_t count)
{
    int32_t largest = INT32_MIN;
    for (; count != 0; count--) {
        dahl_real_t Fc = dahl_part_Fc(parts++);
        largest = Fc.mantissa != 0 && Fc.exponent > largest ? Fc.exponent : largest;
    }
    return largest;
}

DAHL_COLD void dahl_parallel_shares(int32_t *shares, const dahl_part_t *parts, uint32_t count)
{
    const int32_t exponent = largest_exponent(parts, count);
    const uint32_t spare = dahl_part_spare_bits(count);
    uint64_t sum = 0, running = 0;
    uint32_t previous = 0;
    for (uint32_t k = 0; k < count; k++) {
        sum += in_units(dahl_part_Fc(&parts[k]), exponent, spare);
    }
    for (uint32_t k = 0; k < count; k++) {
        running += in_units(dahl_part_Fc(&parts[k]), exponent, spare);
        uint32_t rounded = sum == 0 ? 0 : (uint32_t)((dahl_quotient(running, sum, 32) + 1) >> 1);
        shares[k] = (int32_t)(previous - rounded);
        previous = rounded;
    }
}

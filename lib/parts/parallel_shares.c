/* SPDX-License-Identifier: MIT */
/*
 * What each part is of the sum of Fc, divided once, so that a tick in Q30 multiplies and adds:
 *     share_k = Fc_k / sum of Fc, in Q31
 * The shares are the differences of rounded running sums. So each errs by less than 2^-31, and together they are 1: all parts at
 * Fc give 2^30. They are kept negative, since a word has -2^31, which is the whole, but not 2^31.
 */
#include "part.h"
#include "shift.h"

/* Fc in units of 2^(exponent + spare - 30): the sum of all of them stays below 2^62. */
static DAHL_COLD uint64_t in_units(dahl_real_t Fc, int32_t exponent, uint32_t spare)
{
    return Fc.mantissa == 0 ? 0 : dahl_shifted_right((uint64_t)Fc.mantissa << 30, (uint32_t)(exponent - Fc.exponent) + spare);
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
    uint64_t sum = 0, so_far = 0;
    uint32_t shared = 0;
    for (uint32_t k = 0; k < count; k++) {
        sum += in_units(dahl_part_Fc(&parts[k]), exponent, spare);
    }
    for (uint32_t k = 0; k < count; k++) {
        so_far += in_units(dahl_part_Fc(&parts[k]), exponent, spare);
        uint32_t rounded = sum == 0 ? 0 : (uint32_t)((dahl_quotient(so_far, sum, 32) + 1) >> 1);
        shares[k] = (int32_t)(shared - rounded);
        shared = rounded;
    }
}

/* SPDX-License-Identifier: MIT */
/**
 * Any mix of elements on one shaft, relative to the sum of Fc.
 *
 * F / sum of Fc = sum of share_k w_k, with share_k in Q31 (parallel_shares.c) and w_k in Q30. The shares are
 * negative, and so is the sum until the last line.
 */
#include "../model/bristle_update.h"
#include "dahl_parts.h"

#define HALF_Q61 ((int64_t)1 << 30) /* half a unit of Q30, in units of the sum */

DAHL_WEAK_TICK int32_t dahl_parallel_step_counts_q30(const dahl_part_t *parts, const int32_t *shares, uint32_t count,
                                                     int32_t dcounts)
{
    int64_t opposite = 0;
    for (; count != 0; count--, parts++) {
        uint64_t w = (uint64_t)parts->move(parts->plan, parts->state, dcounts);
        opposite += dahl_mul_signed((int32_t)dahl_q30(w), *shares++);
    }
    return (int32_t)((HALF_Q61 - opposite) >> 31);
}

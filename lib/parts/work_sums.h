/* SPDX-License-Identifier: MIT */
/** The two sums for the work of a Dahl element. */
#ifndef DAHL_WORK_SUMS_H
#define DAHL_WORK_SUMS_H

#include "dahl_parts.h"

/** Add one to the upper words of a sum, lowest first. A carry out of the last word is lost. */
static inline void dahl_work_carry(uint32_t *word, int words)
{
    for (int i = 0, carries = 1; carries != 0 && i < words; i++) {
        word[i]++;
        carries = word[i] == 0;
    }
}

/** Update both sums after a move from `before`. */
static inline void dahl_work_add(dahl_work_t *work, uint64_t before, uint64_t after, int32_t dcounts)
{
    uint64_t way = (uint64_t)work->way[1] << 32 | work->way[0], forward = dcounts < 0 ? before - after : after - before;
    uint32_t counts = dcounts < 0 ? 0u - (uint32_t)dcounts : (uint32_t)dcounts;
    work->counts[0] += counts;
    if (work->counts[0] < counts) {
        dahl_work_carry(&work->counts[1], 2);
    }
    way += forward;
    work->way[0] = (uint32_t)way;
    work->way[1] = (uint32_t)(way >> 32);
    if (way < forward) {
        dahl_work_carry(&work->way[2], 2);
    }
}

#endif

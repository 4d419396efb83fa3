/* SPDX-License-Identifier: MIT */
/* Moves from readings of an absolute encoder. */
#include "dahl.h"

int32_t dahl_counts_between(uint32_t before, uint32_t now, uint32_t counts_per_turn)
{
    if (counts_per_turn == 0) {
        return (int32_t)(now - before);
    }
    before %= counts_per_turn;
    now %= counts_per_turn;
    uint32_t forward = now >= before ? now - before : now + (counts_per_turn - before);
    uint32_t backward = counts_per_turn - forward;
    return forward < backward ? (int32_t)forward : (int32_t)(0u - backward);
}

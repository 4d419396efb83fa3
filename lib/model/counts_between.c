/* SPDX-License-Identifier: MIT */
/** Moves from the readings of a counter that wraps. */
#include "shortest_move.h"

#include "dahl.h"

int32_t dahl_counts_between(uint32_t before, uint32_t now, uint32_t modulus)
{
    return dahl_shortest_move(before, now, modulus);
}

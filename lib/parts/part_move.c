/* SPDX-License-Identifier: MIT */
/** Dahl element as a part of a mix. */
#include "../arith/compiler.h"
#include "dahl_parts.h"

DAHL_WEAK_TICK int64_t dahl_part_move(const void *plan, void *state, int32_t dcounts)
{
    dahl_state_t *element = (dahl_state_t *)state;
    (void)dahl_step_counts_q30((const dahl_plan_t *)plan, element, dcounts);
    return element->w;
}

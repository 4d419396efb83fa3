/* SPDX-License-Identifier: MIT */
/** Check that a state is in range. */
#include "bristle_update.h"

int dahl_state_ok(const dahl_state_t *state)
{
    return dahl_is_gap(dahl_gap_backward((uint64_t)state->w));
}

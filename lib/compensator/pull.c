/* SPDX-License-Identifier: MIT */
/** Pull of the reference law: a first-order low-pass between two states of one element. */
#include "../parts/shift.h"
#include "dahl_compensator.h"

/** The unsigned gap between any two states has 64 bits. */
void dahl_compensator_pull(const dahl_compensator_plan_t *plan, dahl_state_t *state, const dahl_state_t *measured)
{
    const uint64_t from = (uint64_t)state->w, to = (uint64_t)measured->w;
    if (plan->pull_shift == 0) {
        return;
    }
    if (measured->w > state->w) {
        state->w = (int64_t)(from + dahl_shift_right(to - from, plan->pull_shift));
    } else {
        state->w = (int64_t)(from - dahl_shift_right(from - to, plan->pull_shift));
    }
}

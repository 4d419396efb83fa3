/* SPDX-License-Identifier: MIT */
/* A tick in counts that returns N m. */
#include "gap.h"
#include "torque.h"

float dahl_step_counts(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    if (dcounts > 0) {
        if (dcounts > DAHL_DENSE) {
            return dahl_keep(plan, state, dahl_move_digits(plan, state, dcounts));
        }
        return dahl_keep(plan, state, dahl_forward((uint64_t)state->w, *(plan->g + dcounts)));
    }
    if (dcounts < -DAHL_DENSE) {
        return dahl_keep(plan, state, dahl_move_digits(plan, state, dcounts));
    }
    return dahl_keep(plan, state, dahl_backward((uint64_t)state->w, *(plan->g - dcounts)));
}

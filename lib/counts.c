/* SPDX-License-Identifier: MIT */
/* A tick in counts that returns N m. */
#include "gap.h"
#include "torque.h"

float dahl_step_counts(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint64_t w = (uint64_t)state->w;
    if (dcounts > 0) {
        if (dcounts > DAHL_DENSE) {
            return dahl_step_digits(plan, state, dcounts);
        }
        return dahl_keep(plan, state, dahl_forward(w, *(plan->g + dcounts)));
    }
    if (dcounts < -DAHL_DENSE) {
        return dahl_step_digits(plan, state, dcounts);
    }
    return dahl_keep(plan, state, dahl_backward(w, *(plan->g - dcounts)));
}

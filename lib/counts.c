/* SPDX-License-Identifier: MIT */
/* A tick in counts that returns N m. */
#include "gap.h"
#include "torque.h"

static float step_digits(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    dahl_move_digits(plan, state, dcounts);
    return dahl_torque(plan, state);
}

float dahl_step_counts(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    if (dcounts > DAHL_DENSE || dcounts < -DAHL_DENSE) {
        return step_digits(plan, state, dcounts);
    }
    uint64_t w = (uint64_t)state->w;
    w = dcounts > 0 ? dahl_forward(w, plan->g[dcounts]) : dahl_backward(w, *(plan->g - dcounts));
    state->w = (int64_t)w;
    return dahl_torque_of(plan, state->w);
}

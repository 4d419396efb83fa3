/* SPDX-License-Identifier: MIT */
/* A tick in counts that returns N m. */
#include "gap.h"
#include "torque.h"

float dahl_step_counts(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint64_t w = (uint64_t)state->w;
    if (dcounts > DAHL_DENSE || dcounts < -DAHL_DENSE) {
        w = dahl_move_digits(plan, w, dcounts);
    } else if (dcounts > 0) {
        w = dahl_forward(w, &plan->g[dcounts]);
    } else {
        w = dahl_backward(w, &plan->g[-dcounts]);
    }
    state->w = (int64_t)w;
    return dahl_torque_of(plan, state->w);
}

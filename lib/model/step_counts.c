/* SPDX-License-Identifier: MIT */
/** Tick by counts that returns N m. */
#include "bristle_update.h"
#include "torque.h"

static DAHL_OUT_OF_LINE float step_large(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    (void)dahl_step_large(plan, state, dcounts);
    return dahl_torque(plan, state);
}

DAHL_WEAK_TICK float dahl_step_counts(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint64_t w = (uint64_t)state->w;
    if (dcounts > 0) {
        if (dcounts > DAHL_DIRECT_COUNTS_MAX || !dahl_is_gap(dahl_gap_forward(w))) {
            return step_large(plan, state, dcounts);
        }
        w = dahl_forward(w, plan->g[dcounts]);
    } else {
        if (dcounts < -DAHL_DIRECT_COUNTS_MAX || !dahl_is_gap(dahl_gap_backward(w))) {
            return step_large(plan, state, dcounts);
        }
        w = dahl_backward(w, plan->g[-dcounts]);
    }
    state->w = (int64_t)w;
    return dahl_torque_of_inline(plan, w);
}

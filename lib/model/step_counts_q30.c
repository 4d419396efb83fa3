/* SPDX-License-Identifier: MIT */
/** Tick by counts with integers only, in its own file, so that firmware in Q30 links no conversion to float. */
#include "bristle_update.h"

/** A tick without motion moves backward by entry 0, which is 0: all short ticks need the same time. */
DAHL_WEAK_TICK int32_t dahl_step_counts_q30(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint64_t w = (uint64_t)state->w;
    if (dcounts > 0) {
        if (dcounts > DAHL_DIRECT_COUNTS_MAX || !dahl_is_gap(dahl_gap_forward(w))) {
            return dahl_step_large(plan, state, dcounts);
        }
        w = dahl_forward(w, plan->g[dcounts]);
    } else {
        if (dcounts < -DAHL_DIRECT_COUNTS_MAX || !dahl_is_gap(dahl_gap_backward(w))) {
            return dahl_step_large(plan, state, dcounts);
        }
        w = dahl_backward(w, plan->g[-dcounts]);
    }
    state->w = (int64_t)w;
    return (int32_t)dahl_q30(w);
}

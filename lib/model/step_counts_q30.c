/* SPDX-License-Identifier: MIT */
/**
 * @file step_counts_q30.c
 * @brief Tick by counts with integers only.
 *
 * It is separate from step_counts.c so that firmware in Q30 links no conversion to float.
 */
#include "bristle_update.h"

/** A tick without motion moves backward by entry 0, which is 0. All short ticks therefore need the same time. */
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

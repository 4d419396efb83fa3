/* SPDX-License-Identifier: MIT */
/*
 * A tick in counts, integers only. A file of its own: firmware that takes Q30 links no conversion to float. The two
 * directions are written out, and no motion goes backward by entry 0, which is 0: every short tick takes as long.
 */
#include "bristle_update.h"

int32_t dahl_step_counts_q30(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint64_t w;
    if (dcounts <= 0) {
        if (dcounts < -DAHL_DENSE) {
            return dahl_move_digits(plan, state, dcounts);
        }
        w = dahl_backward((uint64_t)state->w, dahl_entry((const char *)plan - dcounts * DAHL_ENTRY));
        state->w = (int64_t)w;
        return (int32_t)dahl_q30(w);
    }
    if (dcounts > DAHL_DENSE) {
        return dahl_move_digits(plan, state, dcounts);
    }
    w = dahl_forward((uint64_t)state->w, dahl_entry((const char *)plan + dcounts * DAHL_ENTRY));
    state->w = (int64_t)w;
    return (int32_t)dahl_q30(w);
}

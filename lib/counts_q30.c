/* SPDX-License-Identifier: MIT */
/* A tick in counts, integers only. A file of its own: firmware that takes Q30 links no conversion to float. */
#include "gap.h"

/* Without motion w is rounded as if it had just been reached: then it never shows more than +-2^30. */
static int32_t at_rest(int64_t w)
{
    return (int32_t)(w < 0 ? dahl_round_backward((uint64_t)w) : dahl_round_forward((uint64_t)w));
}

int32_t dahl_step_counts_q30(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint64_t w = (uint64_t)state->w;
    if (dcounts > 0) {
        w = dcounts > DAHL_DENSE ? dahl_move_digits(plan, w, dcounts) : dahl_forward(w, &plan->g[dcounts]);
        state->w = (int64_t)w;
        return (int32_t)dahl_round_forward(w);
    }
    if (dcounts == 0) {
        return at_rest(state->w);
    }
    w = dcounts < -DAHL_DENSE ? dahl_move_digits(plan, w, dcounts) : dahl_backward(w, &plan->g[-dcounts]);
    state->w = (int64_t)w;
    return (int32_t)dahl_round_backward(w);
}

/* SPDX-License-Identifier: MIT */
/* A tick in counts, integers only. A file of its own: firmware that takes Q30 links no conversion to float. */
#include "gap.h"

/* Without motion w is rounded as if it had just been reached: then it never shows more than +-2^30. */
static int32_t q30_of(int64_t w)
{
    return (int32_t)(w < 0 ? dahl_round_backward((uint64_t)w) : dahl_round_forward((uint64_t)w));
}

/* No motion, or more than the dense entries know. */
static int32_t step_digits(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    dahl_move_digits(plan, state, dcounts);
    return q30_of(state->w);
}

int32_t dahl_step_counts_q30(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint64_t w;
    if (dcounts > 0) {
        if (dcounts > DAHL_DENSE) {
            return step_digits(plan, state, dcounts);
        }
        w = dahl_forward((uint64_t)state->w, &plan->g[dcounts]);
        state->w = (int64_t)w;
        return (int32_t)dahl_round_forward(w);
    }
    if (dcounts < -DAHL_DENSE || dcounts == 0) {
        return step_digits(plan, state, dcounts);
    }
    w = dahl_backward((uint64_t)state->w, &plan->g[-dcounts]);
    state->w = (int64_t)w;
    return (int32_t)dahl_round_backward(w);
}

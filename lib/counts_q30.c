/* SPDX-License-Identifier: MIT */
/* A tick in counts, integers only. A file of its own: firmware that takes Q30 links no conversion to float. */
#include "gap.h"

int32_t dahl_step_counts_q30(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint64_t w;
    if (dcounts > 0) {
        if (dcounts > DAHL_DENSE) {
            return dahl_step_digits_q30(plan, state, dcounts);
        }
        w = dahl_forward((uint64_t)state->w, *(plan->g + dcounts));
        state->w = (int64_t)w;
        return (int32_t)dahl_round_forward(w);
    }
    if ((uint32_t)~dcounts >= DAHL_DENSE) {
        return dahl_step_digits_q30(plan, state, dcounts);
    }
    w = dahl_backward((uint64_t)state->w, *(plan->g - dcounts));
    state->w = (int64_t)w;
    return (int32_t)dahl_round_backward(w);
}

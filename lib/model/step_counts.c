/* SPDX-License-Identifier: MIT */
/* A tick in counts that returns N m. */
#include "bristle_update.h"
#include "torque.h"

float dahl_step_counts(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint64_t w = (uint64_t)state->w;
    if (dcounts > 0) {
        if (dcounts > DAHL_DENSE) {
            (void)dahl_move_digits(plan, state, dcounts);
            return dahl_torque_of(plan, (uint64_t)state->w);
        }
        w = dahl_two_words(dahl_forward(w, dahl_entry((const char *)plan + dcounts * DAHL_ENTRY)));
    } else {
        if (dcounts < -DAHL_DENSE) {
            (void)dahl_move_digits(plan, state, dcounts);
            return dahl_torque_of(plan, (uint64_t)state->w);
        }
        w = dahl_two_words(dahl_backward(w, dahl_entry((const char *)plan - dcounts * DAHL_ENTRY)));
    }
    state->w = (int64_t)w;
    return dahl_torque_here(plan, w);
}

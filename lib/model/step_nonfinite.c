/* SPDX-License-Identifier: MIT */
/* The rare ends of dahl_step: no motion, none that counts, NaN; and infinity. */
#include "bristle_update.h"
#include "torque.h"

float dahl_step_far(const dahl_plan_t *plan, dahl_state_t *state, uint32_t bits)
{
    if ((bits & DAHL_BITS_MAGNITUDE) == DAHL_BITS_INF) {
        state->w = (int64_t)(bits >> 31 ? 0u - DAHL_ONE_Q62 : DAHL_ONE_Q62);
    }
    return dahl_torque_of(plan, (uint64_t)state->w);
}

/* SPDX-License-Identifier: MIT */
/* The rare ends of dahl_step: no motion, none that counts, NaN; and travel that saturates, infinite or not. */
#include "gap.h"
#include "torque.h"

float dahl_step_far(const dahl_plan_t *plan, dahl_state_t *state, uint32_t bits)
{
    static const dahl_q64_t all = {UINT32_MAX, UINT32_MAX};
    uint32_t magnitude = bits & DAHL_BITS_MAGNITUDE;
    uint64_t w = (uint64_t)state->w;
    if (magnitude >= DAHL_BITS_NORMAL && magnitude <= DAHL_BITS_INF) {
        w = bits >> 31 ? dahl_backward(w, all) : dahl_forward(w, all);
    }
    return dahl_keep(plan, state, w);
}

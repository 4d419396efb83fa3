/* SPDX-License-Identifier: MIT */
/** Tick by angle: g(u) from the kernel, then the same update as by counts. */
#include "bristle_update.h"
#include "kernel.h"
#include "torque.h"

float dahl_step(const dahl_plan_t *plan, dahl_state_t *state, float dtheta)
{
    uint32_t bits = dahl_bits_of(dtheta), magnitude = bits & DAHL_BITS_MAGNITUDE;
    uint64_t w = (uint64_t)state->w;
    if (magnitude - DAHL_BITS_NORMAL >= DAHL_BITS_INF - DAHL_BITS_NORMAL || plan->a_mantissa == 0
        || !dahl_is_gap(dahl_gap_backward(w))) {
        return dahl_step_rare(plan, state, bits);
    }
    dahl_q64_t g = dahl_kernel(dahl_travel(plan, magnitude));
    w = (bits & DAHL_BITS_SIGN) != 0 ? dahl_backward(w, g) : dahl_forward(w, g);
    state->w = (int64_t)w;
    return dahl_torque_of(plan, w);
}

/* SPDX-License-Identifier: MIT */
/** Tick by angle: g(u) from the kernel, then the same update as by counts. Only a usual travel is handled here. */
#include "kernel.h"
#include "torque.h"

/** Return true for a far plan, infinity, NaN, and a large angle on a plan of all zeros. */
static inline int is_rare(dahl_scaled_t v, uint32_t bits)
{
    return v.shift > DAHL_FAR_SHIFT
        || (v.shift < -8 && ((bits & DAHL_BITS_MAGNITUDE) >= DAHL_BITS_INF || v.mantissa == 0));
}

DAHL_WEAK_TICK float dahl_step(const dahl_plan_t *plan, dahl_state_t *state, float dtheta)
{
    uint32_t bits = dahl_bits_of(dtheta);
    uint64_t w = (uint64_t)state->w;
    dahl_scaled_t v = dahl_travel(plan->a_mantissa, plan->a_exponent, bits);
    if (is_rare(v, bits) || !dahl_is_gap(dahl_gap_backward(w))) {
        return dahl_step_rare(plan, state, bits);
    }
    dahl_scaled_t g = dahl_kernel(v);
    w = (bits & DAHL_BITS_SIGN) != 0 ? dahl_backward_by_angle(w, g) : dahl_forward_by_angle(w, g);
    state->w = (int64_t)w;
    return dahl_torque_of_inline(plan, w);
}

/* SPDX-License-Identifier: MIT */
/** Any move by angle, also a rare one: clamp a state out of range, ignore 0, a subnormal number and NaN, saturate at
 * infinity, and return 0 for a plan of all zeros. */
#include "kernel.h"

static uint64_t move_rare(const dahl_plan_t *plan, uint64_t w, uint32_t bits)
{
    uint32_t magnitude = bits & DAHL_BITS_MAGNITUDE, is_backward = bits & DAHL_BITS_SIGN;
    if (plan->a_mantissa == 0 || magnitude < DAHL_BITS_NORMAL || magnitude > DAHL_BITS_INF) {
        return w;
    }
    if (magnitude == DAHL_BITS_INF) {
        return is_backward ? 0u - DAHL_ONE_Q62 : DAHL_ONE_Q62;
    }
    dahl_scaled_t g = dahl_kernel(dahl_travel(plan->a_mantissa, dahl_a_exponent(plan), bits));
    return is_backward ? dahl_backward_by_angle(w, g) : dahl_forward_by_angle(w, g);
}

DAHL_COLD float dahl_step_rare(const dahl_plan_t *plan, dahl_state_t *state, uint32_t bits)
{
    state->w = (int64_t)move_rare(plan, dahl_clamp((uint64_t)state->w), bits);
    return dahl_torque(plan, state);
}

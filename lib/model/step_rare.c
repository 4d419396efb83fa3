/* SPDX-License-Identifier: MIT */
/** Rare cases of dahl_step(): clamp a state out of range, ignore 0, a subnormal number and NaN, saturate at
 * infinity, and return 0 for a plan of all zeros. */
#include "bristle_update.h"

DAHL_COLD float dahl_step_rare(const dahl_plan_t *plan, dahl_state_t *state, uint32_t bits)
{
    uint32_t magnitude = bits & DAHL_BITS_MAGNITUDE;
    state->w = (int64_t)dahl_clamp((uint64_t)state->w);
    if (plan->a_mantissa != 0 && magnitude >= DAHL_BITS_NORMAL && magnitude < DAHL_BITS_INF) {
        return dahl_step(plan, state, dahl_float_of(bits));
    }
    if (plan->a_mantissa != 0 && magnitude == DAHL_BITS_INF) {
        state->w = (int64_t)((bits & DAHL_BITS_SIGN) != 0 ? 0u - DAHL_ONE_Q62 : DAHL_ONE_Q62);
    }
    return dahl_torque(plan, state);
}

/* SPDX-License-Identifier: MIT */
/* The rare ends of dahl_step: no motion, none that counts, NaN; infinity, which saturates; a plan of all zeros, which moves
 * nothing. */
#include "bristle_update.h"
#include "torque.h"

float dahl_step_nonfinite(const dahl_plan_t *plan, dahl_state_t *state, uint32_t bits)
{
    if ((bits & DAHL_BITS_MAGNITUDE) == DAHL_BITS_INF && plan->a_mantissa != 0) {
        state->w = (int64_t)((bits & DAHL_BITS_SIGN) != 0 ? 0u - DAHL_ONE_Q62 : DAHL_ONE_Q62);
    }
    return dahl_torque(plan, state);
}

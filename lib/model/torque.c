/* SPDX-License-Identifier: MIT */
/** Torque of a state without motion. */
#include "bristle_update.h"
#include "torque.h"

float dahl_torque(const dahl_plan_t *plan, const dahl_state_t *state)
{
    return dahl_torque_of(plan, dahl_clamp((uint64_t)state->w));
}

/* SPDX-License-Identifier: MIT */
/* The torque of a state, without motion. */
#include "torque.h"

DAHL_OUT_OF_LINE float dahl_torque_of(const dahl_plan_t *plan, uint64_t w)
{
    return dahl_torque_here(plan, w);
}

float dahl_torque(const dahl_plan_t *plan, const dahl_state_t *state)
{
    return dahl_torque_of(plan, (uint64_t)state->w);
}

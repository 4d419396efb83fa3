/* SPDX-License-Identifier: MIT */
/* The torque without motion, and after a long one. */
#include "gap.h"
#include "torque.h"

float dahl_torque(const dahl_plan_t *plan, const dahl_state_t *state)
{
    return dahl_torque_of(plan, state->w);
}

float dahl_step_digits(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    dahl_move_digits(plan, state, dcounts);
    return dahl_torque_of(plan, state->w);
}

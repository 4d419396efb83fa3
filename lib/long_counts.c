/* SPDX-License-Identifier: MIT */
/* The rest of dahl_step_counts for long moves, out of line: what a short tick does not call costs it nothing. */
#include "gap.h"

float dahl_step_digits(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    (void)dahl_move_digits(plan, state, dcounts);
    return dahl_torque(plan, state);
}

/* SPDX-License-Identifier: MIT */
/** Set the state to a torque in N m. */
#include "bristle_update.h"

/** Return |F|/Fc in Q62, clamped to 1. It is 0 if F is subnormal or if the plan is all zeros. */
static uint64_t size_of(const dahl_plan_t *plan, uint32_t magnitude)
{
    const dahl_real_t Fc = {plan->Fc_mantissa, plan->Fc_exponent};
    if (magnitude < DAHL_BITS_NORMAL || Fc.mantissa == 0) {
        return 0;
    }
    return dahl_ratio_q62(dahl_real_of(magnitude), Fc);
}

void dahl_set_torque(const dahl_plan_t *plan, dahl_state_t *state, float F)
{
    uint32_t bits = dahl_bits_of(F), magnitude = bits & DAHL_BITS_MAGNITUDE;
    if (magnitude > DAHL_BITS_INF) { /* NaN */
        state->w = (int64_t)dahl_clamp((uint64_t)state->w);
        return;
    }
    uint64_t size = size_of(plan, magnitude);
    state->w = (int64_t)((bits & DAHL_BITS_SIGN) != 0 ? 0u - size : size);
}

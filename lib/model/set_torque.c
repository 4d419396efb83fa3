/* SPDX-License-Identifier: MIT */
/* The state from a torque in N m. */
#include "../arith/fixed.h"

/* F/Fc in Q62 for normal F < Fc, rounded. */
static uint64_t ratio_q62(dahl_real_t F, const dahl_plan_t *plan)
{
    uint64_t quotient = dahl_quotient_q63(F.mantissa, dahl_mantissa_of_Fc(plan));
    int32_t shift = dahl_exponent_of_Fc(plan) - F.exponent;
    return shift > 63 ? 0u : ((quotient >> shift) + 1) >> 1;
}

static int is_below_Fc(dahl_real_t F, const dahl_plan_t *plan)
{
    int32_t exponent = dahl_exponent_of_Fc(plan);
    return F.exponent < exponent || (F.exponent == exponent && F.mantissa < dahl_mantissa_of_Fc(plan));
}

void dahl_set_torque(const dahl_plan_t *plan, dahl_state_t *state, float F)
{
    uint32_t bits = dahl_bits_of(F);
    uint32_t magnitude = bits & DAHL_BITS_MAGNITUDE;
    dahl_real_t size = dahl_real_of(magnitude);
    uint64_t w = 0;
    if (magnitude > DAHL_BITS_INF) {
        return;
    }
    if (!is_below_Fc(size, plan)) {
        w = DAHL_ONE_Q62;
    } else if (magnitude >= DAHL_BITS_NORMAL) {
        w = ratio_q62(size, plan);
    }
    state->w = (int64_t)(bits >> 31 ? 0u - w : w);
}

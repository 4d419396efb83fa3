/* SPDX-License-Identifier: MIT */
/* The state from a torque in N m. */
#include "../arith/fixed.h"
#include "dahl.h"

static int is_below(dahl_real_t x, dahl_real_t y)
{
    return x.exponent != y.exponent ? x.exponent < y.exponent : x.mantissa < y.mantissa;
}

/* F/Fc in Q62, rounded, for F < Fc. */
static uint64_t ratio_q62(dahl_real_t F, dahl_real_t Fc)
{
    uint64_t quotient = dahl_quotient_q63(F.mantissa, Fc.mantissa);
    int32_t shift = Fc.exponent - F.exponent;
    return shift > 63 ? 0 : ((quotient >> shift) + 1) >> 1;
}

/* |F|/Fc in Q62, clamped to 1. A subnormal F is none, and without Fc (a plan of all zeros) there is no torque. */
static uint64_t size_of(const dahl_plan_t *plan, uint32_t magnitude)
{
    dahl_real_t F = dahl_real_of(magnitude), Fc = {plan->Fc_mantissa, plan->Fc_exponent};
    if (magnitude < DAHL_BITS_NORMAL || Fc.mantissa == 0) {
        return 0;
    }
    return is_below(F, Fc) ? ratio_q62(F, Fc) : DAHL_ONE_Q62;
}

void dahl_set_torque(const dahl_plan_t *plan, dahl_state_t *state, float F)
{
    uint32_t bits = dahl_bits_of(F), magnitude = bits & DAHL_BITS_MAGNITUDE;
    if (magnitude > DAHL_BITS_INF) { /* NaN */
        return;
    }
    uint64_t size = size_of(plan, magnitude);
    state->w = (int64_t)((bits & DAHL_BITS_SIGN) != 0 ? 0u - size : size);
}

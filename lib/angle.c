/* SPDX-License-Identifier: MIT */
/* A tick by angle: u = a |dtheta| as a product of mantissas, g(u) by the kernel, then the same gap step as by counts. */
#include "gap.h"
#include "kernel.h"
#include "torque.h"

/* a |dtheta|, for a normal float's bits. */
static dahl_real_t travel_of(const dahl_plan_t *plan, uint32_t magnitude)
{
    dahl_real_t u = dahl_real_of(magnitude);
    uint64_t product = (uint64_t)u.mantissa * plan->a_mantissa;
    uint32_t carry = (uint32_t)(product >> 63);
    u.mantissa = (uint32_t)(product >> (31 + carry));
    u.exponent += plan->a_exponent + 31 + (int32_t)carry;
    return u;
}

/* The gap z times g, in Q62, rounded; 0 below half a unit. */
static uint64_t moved_by(uint32_t z, dahl_real_t g)
{
    uint64_t product = (uint64_t)z * g.mantissa;
    int32_t shift = -32 - g.exponent;
    if (shift == 0) {
        return product;
    }
    return shift > 63 ? 0u : (product + ((uint64_t)1 << (shift - 1))) >> shift;
}

float dahl_step(const dahl_plan_t *plan, dahl_state_t *state, float dtheta)
{
    uint32_t bits = dahl_bits_of(dtheta);
    uint32_t magnitude = bits & DAHL_BITS_MAGNITUDE;
    if (magnitude >= DAHL_BITS_NORMAL && magnitude <= DAHL_BITS_INF) {
        uint64_t w = (uint64_t)state->w;
        dahl_real_t g = dahl_kernel(travel_of(plan, magnitude));
        if (bits >> 31) {
            w -= moved_by(DAHL_ONE_Q30 + dahl_round_backward(w), g);
        } else {
            w += moved_by(DAHL_ONE_Q30 - dahl_round_forward(w), g);
        }
        state->w = (int64_t)w;
    }
    return dahl_torque_of(plan, state->w);
}

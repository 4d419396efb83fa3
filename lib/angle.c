/* SPDX-License-Identifier: MIT */
/* A tick by angle: u = a |dtheta| as a product of mantissas, g(u) by the kernel, then the same gap step as by counts. */
#include "gap.h"
#include "kernel.h"
#include "torque.h"

/* a |dtheta|, for a normal float's bits, infinity included. */
static inline dahl_real_t travel_of(const dahl_plan_t *plan, uint32_t magnitude)
{
    dahl_real_t u = dahl_real_of(magnitude);
    uint64_t product = dahl_mul(u.mantissa, plan->a_mantissa);
    u.mantissa = (uint32_t)(product >> 32);
    u.exponent += plan->a_exponent + 32;
    if (!(u.mantissa & DAHL_TOP_BIT)) {
        u.mantissa = (uint32_t)(product >> 31);
        u.exponent--;
    }
    return u;
}

/* g in Q64, with the 2 units of 2^-64 that gap.h wants; nothing is left of travel below 2^-64. */
static inline dahl_q64_t q64_of(dahl_real_t g)
{
    int32_t shift = -32 - g.exponent;
    uint64_t whole = (uint64_t)g.mantissa << 32;
    if (shift != 0) {
        whole = shift < 64 ? (whole >> shift) + 2u : 0u;
    }
    dahl_q64_t q = {(uint32_t)(whole >> 32), (uint32_t)whole};
    return q;
}

float dahl_step(const dahl_plan_t *plan, dahl_state_t *state, float dtheta)
{
    uint32_t bits = dahl_bits_of(dtheta);
    uint32_t magnitude = bits & DAHL_BITS_MAGNITUDE;
    if (magnitude >= DAHL_BITS_NORMAL && magnitude <= DAHL_BITS_INF) {
        uint64_t w = (uint64_t)state->w;
        dahl_q64_t g = q64_of(dahl_kernel(travel_of(plan, magnitude)));
        state->w = (int64_t)(bits >> 31 ? dahl_backward(w, g) : dahl_forward(w, g));
    }
    return dahl_torque_of(plan, state->w);
}

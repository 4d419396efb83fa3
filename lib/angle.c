/* SPDX-License-Identifier: MIT */
/* A tick by angle: u = a |dtheta| as a product of mantissas, g(u) by the kernel, then the same gap step as by counts. */
#include "gap.h"
#include "kernel.h"
#include "torque.h"

/* u = a |dtheta|, for a normal float's bits. */
static inline dahl_scaled_t travel_of(const dahl_plan_t *plan, uint32_t magnitude)
{
    uint64_t product = dahl_mul(DAHL_TOP_BIT | magnitude << 8, plan->a_mantissa);
    dahl_scaled_t u = {(uint32_t)(product >> 32), plan->a_shift - (int32_t)(magnitude >> 23)};
    if (!(u.mantissa & DAHL_TOP_BIT)) {
        u.mantissa = (uint32_t)(product >> 31);
        u.shift++;
    }
    return u;
}

/* g in Q64, with the 2 units of 2^-64 that gap.h wants; nothing is left of travel below 2^-64. */
static inline dahl_q64_t q64_of(dahl_scaled_t g)
{
    dahl_q64_t q = {g.mantissa, 0};
    if (g.shift >= 32) {
        q.hi = 0;
        q.lo = g.shift < 64 ? (g.mantissa >> (g.shift - 32)) + 2u : 0u;
    } else if (g.shift != 0) {
        q.lo = (g.mantissa << (32 - g.shift)) + 2u;
        q.hi = (g.mantissa >> g.shift) + (q.lo < 2u);
    }
    DAHL_KEEP_32(q.hi);
    DAHL_KEEP_32(q.lo);
    return q;
}

float dahl_step(const dahl_plan_t *plan, dahl_state_t *state, float dtheta)
{
    uint32_t bits = dahl_bits_of(dtheta);
    uint32_t magnitude = bits & DAHL_BITS_MAGNITUDE;
    if (magnitude - DAHL_BITS_NORMAL >= plan->near) {
        return dahl_step_far(plan, state, bits);
    }
    dahl_q64_t g = q64_of(dahl_kernel(travel_of(plan, magnitude)));
    if (bits >> 31) {
        return dahl_keep(plan, state, dahl_backward((uint64_t)state->w, g));
    }
    return dahl_keep(plan, state, dahl_forward((uint64_t)state->w, g));
}

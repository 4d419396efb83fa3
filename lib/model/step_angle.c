/* SPDX-License-Identifier: MIT */
/* A tick by angle: g(u) by the kernel, then the same gap step as by counts. */
#include "bristle_update.h"
#include "kernel.h"
#include "torque.h"

static DAHL_OUT_OF_LINE float step_by_bits(const dahl_plan_t *plan, dahl_state_t *state, uint32_t bits)
{
    uint32_t magnitude = bits & DAHL_BITS_MAGNITUDE;
    if (magnitude - DAHL_BITS_NORMAL >= DAHL_BITS_INF - DAHL_BITS_NORMAL) {
        return dahl_step_far(plan, state, bits);
    }
    dahl_q64_t g = dahl_kernel(dahl_travel(plan, magnitude));
    DAHL_KEEP(g.hi);
    DAHL_KEEP(g.lo);
    uint64_t w = (uint64_t)state->w;
    if (bits >> 31) {
        w = dahl_two_words(dahl_backward(w, g));
    } else {
        w = dahl_two_words(dahl_forward(w, g));
    }
    state->w = (int64_t)w;
    return dahl_torque_of(plan, w);
}

/* A jump with the bits in a register: the compiler would take a float there over the stack. */
float dahl_step(const dahl_plan_t *plan, dahl_state_t *state, float dtheta)
{
    return step_by_bits(plan, state, dahl_bits_of(dtheta));
}

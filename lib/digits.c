/* SPDX-License-Identifier: MIT */
/* A move of many counts is the moves of its digits, one after the other: the low three bits, 8 counts, 16, 32 ... */
#include "gap.h"

static uint64_t move(uint64_t w, int32_t direction, dahl_q64_t g)
{
    return direction < 0 ? dahl_backward(w, g) : dahl_forward(w, g);
}

uint64_t dahl_move_digits(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint32_t n = dcounts < 0 ? 0u - (uint32_t)dcounts : (uint32_t)dcounts;
    const dahl_q64_t *g = &plan->g[DAHL_DENSE];
    uint64_t w = move((uint64_t)state->w, dcounts, plan->g[n % DAHL_DENSE]);
    for (n /= DAHL_DENSE; n != 0; n >>= 1, g++) {
        if (n & 1u) {
            w = move(w, dcounts, *g);
        }
    }
    state->w = (int64_t)w;
    return w;
}

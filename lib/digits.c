/* SPDX-License-Identifier: MIT */
/* A move of many counts is the moves of its digits, one after the other: the low three bits, 8 counts, 16, 32 ... */
#include "gap.h"

uint64_t dahl_move_digits(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint32_t n = dcounts < 0 ? 0u - (uint32_t)dcounts : (uint32_t)dcounts;
    uint32_t rest = n / DAHL_DENSE, digit;
    const dahl_q64_t *g = &plan->g[n % DAHL_DENSE], *place = &plan->g[DAHL_DENSE - 1];
    uint64_t w = (uint64_t)state->w;
    for (;;) {
        w = dcounts < 0 ? dahl_backward(w, *g) : dahl_forward(w, *g);
        if (rest == 0) {
            break;
        }
        do {
            place++;
            digit = rest & 1u;
            rest >>= 1;
        } while (digit == 0);
        g = place;
    }
    state->w = (int64_t)w;
    return w;
}

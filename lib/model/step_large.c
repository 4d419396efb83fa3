/* SPDX-License-Identifier: MIT */
/*
 * A move of many counts is the moves of its digits, one after the other: the low three bits, 8 counts, 16, 32 ...
 * Backward it is the forward move of the complement: bristle_update.h rounds ~w to just the opposite of what it rounds w to.
 */
#include "bristle_update.h"

DAHL_SMALL int32_t dahl_move_digits(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint64_t w = (uint64_t)state->w;
    uint32_t n = (uint32_t)dcounts, digit = 1;
    if (dcounts < 0) {
        w = ~w;
        n = 0u - n;
    }
    const dahl_q64_t *g = &plan->g[n % DAHL_DENSE], *place = &plan->g[DAHL_DENSE - 1];
    for (n /= DAHL_DENSE;; n >>= 1) {
        if (digit != 0) {
            w = dahl_forward(w, *g);
        }
        if (n == 0) {
            break;
        }
        g = ++place;
        digit = n & 1u;
    }
    w = dcounts < 0 ? ~w : w;
    state->w = (int64_t)w;
    return (int32_t)dahl_q30(w);
}

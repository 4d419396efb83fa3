/* SPDX-License-Identifier: MIT */
/** Move by many counts, digit by digit: the low three bits, then 8 counts, 16, 32 ... A backward move is the
 * forward move of the complement, because bristle_update.h rounds ~w exactly opposite to w. */
#include "bristle_update.h"

#define LOW_DIGITS DAHL_DIRECT_COUNTS_MAX /* values of the low digit: 0 .. 7 */

static DAHL_COLD uint64_t forward_by(const dahl_plan_t *plan, uint64_t w, uint32_t counts)
{
    const dahl_q64_t *g = &plan->g[LOW_DIGITS];
    w = dahl_forward(w, plan->g[counts % LOW_DIGITS]);
    for (uint32_t digits = counts / LOW_DIGITS; digits != 0; digits >>= 1) {
        if (digits & 1) {
            w = dahl_forward(w, *g);
        }
        g++;
    }
    return w;
}

DAHL_COLD int32_t dahl_step_large(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint64_t w = dahl_clamp((uint64_t)state->w);
    w = dcounts < 0 ? ~forward_by(plan, ~w, 0u - (uint32_t)dcounts) : forward_by(plan, w, (uint32_t)dcounts);
    state->w = (int64_t)w;
    return (int32_t)dahl_q30(w);
}

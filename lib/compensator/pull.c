/* SPDX-License-Identifier: MIT */
/** Pull of the reference law: a first-order low-pass between two states of one element. */
#include "dahl_compensator.h"

/** Return the upper word of a state: Q30. */
static inline int32_t ratio_of(const dahl_state_t *state)
{
    return (int32_t)(state->w >> 32);
}

/** Only the upper words matter for a low-pass. Each is shifted before the difference, which then fits 32 bits for any
 * state. The lower word stays and could carry a state beyond an end of its range, +-2^30. So a target at an end is one
 * unit closer to 0, as all negative targets are. */
void dahl_compensator_pull(const dahl_compensator_plan_t *plan, dahl_state_t *state, const dahl_state_t *measured)
{
    const uint8_t shift = plan->pull_shift;
    if (shift != 0) {
        const int32_t target = ratio_of(measured) - (ratio_of(measured) >> 30);
        uint32_t ratio = (uint32_t)ratio_of(state) + (uint32_t)((target >> shift) - (ratio_of(state) >> shift));
        state->w = (int64_t)((uint64_t)ratio << 32 | (uint32_t)state->w);
    }
}

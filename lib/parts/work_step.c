/* SPDX-License-Identifier: MIT */
/** Ticks that add up the work, in the sums of work_sums.h. */
#include "../arith/compiler.h"
#include "../model/bristle_update.h"
#include "work_sums.h"

DAHL_WEAK_TICK float dahl_work_step_counts(const dahl_plan_t *plan, dahl_state_t *state, dahl_work_t *work, int32_t dcounts)
{
    uint64_t before = dahl_clamp((uint64_t)state->w);
    float F = dahl_step_counts(plan, state, dcounts);
    dahl_work_add(work, before, (uint64_t)state->w, dcounts);
    return F;
}

DAHL_WEAK_TICK int32_t dahl_work_step_counts_q30(const dahl_plan_t *plan, dahl_state_t *state, dahl_work_t *work,
                                                 int32_t dcounts)
{
    uint64_t before = dahl_clamp((uint64_t)state->w);
    int32_t ratio = dahl_step_counts_q30(plan, state, dcounts);
    dahl_work_add(work, before, (uint64_t)state->w, dcounts);
    return ratio;
}

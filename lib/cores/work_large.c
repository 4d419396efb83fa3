/* SPDX-License-Identifier: MIT */
/** Move of more than 8 counts that adds up its work, for the assembly ticks. Returns F/Fc in Q30. */
#include "../model/bristle_update.h"
#include "../parts/work_sums.h"

#if DAHL_THUMB2
int32_t dahl_work_step_large(const dahl_plan_t *plan, dahl_state_t *state, dahl_work_t *work, int32_t dcounts);

DAHL_COLD int32_t dahl_work_step_large(const dahl_plan_t *plan, dahl_state_t *state, dahl_work_t *work, int32_t dcounts)
{
    uint64_t before = dahl_clamp((uint64_t)state->w);
    int32_t ratio = dahl_step_large(plan, state, dcounts);
    dahl_work_add(work, before, (uint64_t)state->w, dcounts);
    return ratio;
}
#endif

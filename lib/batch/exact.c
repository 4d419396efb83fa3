/* SPDX-License-Identifier: MIT */
/*
 * One trajectory after the other's tick, bit for bit as single steps. By counts: the direction is a mask, not a branch, so
 * that a motion whose sign nobody can predict costs no more; short moves take their table entry, the rest go by digits.
 */
#include "exact.h"

void dahl_batch_counts(const dahl_plan_t *plan, dahl_state_t *state, const int32_t *dcounts, float *F, size_t n)
{
    double unit = dahl_batch_unit(plan);
    uint64_t w = (uint64_t)state->w;
    for (size_t i = 0; i < n; i++) {
        w = dahl_batch_move(plan, w, dcounts[i]);
        F[i] = dahl_batch_torque(plan, (int64_t)w, unit);
    }
    state->w = (int64_t)w;
}

void dahl_batch(const dahl_plan_t *plan, dahl_state_t *state, const float *dtheta, float *F, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        F[i] = dahl_step(plan, state, dtheta[i]);
    }
}

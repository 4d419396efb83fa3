/* SPDX-License-Identifier: MIT */
/** One trajectory with the bits of single steps. By counts, the direction is a mask instead of a branch, so an
 * unpredictable sign costs no more. Short moves use their table entry, longer ones go digit by digit. A block first
 * computes its dependent states, then its independent torques with vectors. */
#include "exact.h"

#define BLOCK 64 /* ticks */

typedef struct {
    const dahl_plan_t *plan;
    dahl_state_t *state;
    const int32_t *dcounts;
    float *F;
    size_t n;
} job_t;

/** Write w after each tick. Between ticks, w is kept as seen in the direction of travel. */
DAHL_INLINE void move_all(const dahl_plan_t *plan, int64_t *w, uint64_t start, const int32_t *dcounts, size_t n)
{
    uint64_t ahead = start, backward = 0;
    for (size_t i = 0; i < n; i++) {
        uint64_t before = backward;
        backward = dahl_batch_direction(dcounts[i]);
        ahead = dahl_batch_move(plan, ahead ^ before ^ backward, dahl_batch_size(dcounts[i]));
        w[i] = (int64_t)(ahead ^ backward);
    }
}

DAHL_INLINE void run(const job_t *job, bool converts)
{
    const double unit = dahl_batch_unit(job->plan);
    size_t rows;
    int64_t w[BLOCK];
    for (size_t i = 0; i < job->n; i += rows) {
        rows = job->n - i < BLOCK ? job->n - i : BLOCK;
        move_all(job->plan, w, (uint64_t)job->state->w, job->dcounts + i, rows);
        dahl_batch_torques(job->plan, &unit, 0, w, job->F + i, rows, converts);
        job->state->w = w[rows - 1];
    }
}
DAHL_VARIANTS_CONVERT(run_ticks, job_t, run)

void dahl_batch_counts(const dahl_plan_t *plan, dahl_state_t *state, const int32_t *dcounts, float *F, size_t n)
{
    job_t job = {plan, state, dcounts, F, n};
    if (n != 0) { /* once per call: each tick leaves a state in range */
        state->w = (int64_t)dahl_clamp((uint64_t)state->w);
    }
    run_ticks(&job);
}

void dahl_batch(const dahl_plan_t *plan, dahl_state_t *state, const float *dtheta, float *F, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        F[i] = dahl_step(plan, state, dtheta[i]);
    }
}

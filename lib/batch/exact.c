/* SPDX-License-Identifier: MIT */
/** Logs with the bits of single steps: each call is the loop that a firmware would run. And parts for callers from
 * other languages. */
#include "dahl_batch.h"

void dahl_batch_counts(const dahl_plan_t *plan, dahl_state_t *state, const int32_t *dcounts, float *F, size_t n)
{
    dahl_batch_counts_channels(plan, state, 1, dcounts, F, n);
}

void dahl_batch(const dahl_plan_t *plan, dahl_state_t *state, const float *dtheta, float *F, size_t n)
{
    dahl_batch_channels(plan, state, 1, dtheta, F, n);
}

void dahl_batch_counts_channels(const dahl_plan_t *plans, dahl_state_t *states, size_t channels, const int32_t *dcounts,
                                float *F, size_t n)
{
    size_t c = 0;
    for (size_t i = 0; i < n * channels; i++) {
        F[i] = dahl_step_counts(&plans[c], &states[c], dcounts[i]);
        c = c + 1 < channels ? c + 1 : 0;
    }
}

void dahl_batch_channels(const dahl_plan_t *plans, dahl_state_t *states, size_t channels, const float *dtheta, float *F,
                         size_t n)
{
    size_t c = 0;
    for (size_t i = 0; i < n * channels; i++) {
        F[i] = dahl_step(&plans[c], &states[c], dtheta[i]);
        c = c + 1 < channels ? c + 1 : 0;
    }
}

dahl_part_t dahl_batch_part(const dahl_plan_t *plan, dahl_state_t *state)
{
    dahl_part_t part = DAHL_PART(plan, state);
    return part;
}

dahl_part_t dahl_batch_slip_part(const dahl_slip_plan_t *plan, dahl_slip_state_t *state)
{
    dahl_part_t part = DAHL_SLIP_PART(plan, state);
    return part;
}

void dahl_batch_slip_counts(const dahl_slip_plan_t *plan, dahl_slip_state_t *state, const int32_t *dcounts, float *F, size_t n)
{
    for (size_t t = 0; t < n; t++) {
        F[t] = dahl_slip_step_counts(plan, state, dcounts[t]);
    }
}

void dahl_batch_parallel_counts(const dahl_part_t *parts, uint32_t count, const int32_t *dcounts, float *F, size_t n)
{
    for (size_t t = 0; t < n; t++) {
        F[t] = dahl_parallel_step_counts(parts, count, dcounts[t]);
    }
}

#define RUN_COUNTS(name, ...)                                                                                                  \
    void dahl_batch_##name##_counts(const dahl_##name##_plan_t *plan, dahl_state_t *state, const int32_t *dcounts, float *F,   \
                                    size_t n)                                                                                  \
    {                                                                                                                          \
        for (size_t t = 0; t < n; t++) {                                                                                       \
            F[t] = dahl_##name##_step_counts(plan, state, dcounts[t]);                                                         \
        }                                                                                                                      \
    }
DAHL_BRISTLE_MODELS(RUN_COUNTS)

void dahl_batch_loaded_counts(const dahl_plan_t *plan, dahl_loaded_state_t *state, const int32_t *dcounts,
                              const uint32_t *load_q30, float *F, size_t n)
{
    for (size_t t = 0; t < n; t++) {
        F[t] = dahl_loaded_step_counts(plan, state, dcounts[t], load_q30[t]);
    }
}

void dahl_batch_work_counts(const dahl_plan_t *plan, dahl_state_t *state, dahl_work_t *work, const int32_t *dcounts, float *F,
                            size_t n)
{
    for (size_t t = 0; t < n; t++) {
        F[t] = dahl_work_step_counts(plan, state, work, dcounts[t]);
    }
}

void dahl_batch_velocity(const dahl_velocity_plan_t *plan, const int32_t *dcounts, float *F, size_t n)
{
    for (size_t t = 0; t < n; t++) {
        F[t] = dahl_velocity_torque(plan, dcounts[t]);
    }
}

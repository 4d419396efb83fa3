/* SPDX-License-Identifier: MIT */
/*
 * Batches, for long logs on a host; each in a file of its own, linked only when called. n ticks in, n torques in N m out,
 * states moved on; nothing is allocated. As in dahl.h, every call first clamps its states, so any bits are safe ones. Arrays must
 * not overlap. n or channels of 0 does nothing. Many channels: tick after tick, move t of channel c at [t * channels + c], F as
 * well; plans[c], params[c], states[c].
 */
#ifndef DAHL_BATCH_H
#define DAHL_BATCH_H

#include <stddef.h>
#include "dahl.h"
#include "dahl_parts.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Exact: the bits of dahl_step_counts and dahl_step, tick by tick, while the processor rounds to nearest, as it starts. */
void dahl_batch_counts(const dahl_plan_t *plan, dahl_state_t *state, const int32_t *dcounts, float *F, size_t n);
void dahl_batch(const dahl_plan_t *plan, dahl_state_t *state, const float *dtheta, float *F, size_t n);
void dahl_batch_counts_channels(const dahl_plan_t *plans, dahl_state_t *states, size_t channels, const int32_t *dcounts,
                                float *F, size_t n);
void dahl_batch_channels(const dahl_plan_t *plans, dahl_state_t *states, size_t channels, const float *dtheta, float *F,
                         size_t n);

/* DAHL_PART and DAHL_SLIP_PART, for callers from other languages. */
dahl_part_t dahl_batch_part(const dahl_plan_t *plan, dahl_state_t *state);
dahl_part_t dahl_batch_slip_part(const dahl_slip_plan_t *plan, dahl_slip_state_t *state);

/* Parts (dahl_parts.h): the bits of dahl_NAME_step_counts and of dahl_velocity_torque, tick by tick. */
void dahl_batch_slip_counts(const dahl_slip_plan_t *plan, dahl_slip_state_t *state, const int32_t *dcounts, float *F, size_t n);
void dahl_batch_parallel_counts(const dahl_part_t *parts, uint32_t count, const int32_t *dcounts, float *F, size_t n);
void dahl_batch_asymmetric_counts(const dahl_asymmetric_plan_t *plan, dahl_state_t *state, const int32_t *dcounts, float *F,
                                  size_t n);
void dahl_batch_loaded_counts(const dahl_plan_t *plan, dahl_loaded_state_t *state, const int32_t *dcounts,
                              const uint32_t *load_q30, float *F, size_t n);
void dahl_batch_elastoplastic_counts(const dahl_elastoplastic_plan_t *plan, dahl_state_t *state, const int32_t *dcounts,
                                     float *F, size_t n);
void dahl_batch_work_counts(const dahl_plan_t *plan, dahl_state_t *state, dahl_work_t *work, const int32_t *dcounts, float *F,
                            size_t n);
void dahl_batch_velocity(const dahl_velocity_plan_t *plan, const int32_t *dcounts, float *F, size_t n);

/*
 * Throughput: the same recurrence in double, in vectors. Other bits (those of the processor's vectors), the same bounds:
 * DAHL_ULP_COUNTS ulp of Fc (of floats as large as it) by counts and, while each |u| >= 2^-30 or 0, by angle; without end.
 * Parameters are double and need no plan; limits and codes are those of dahl_prepare, and on a code nothing is touched. NaN
 * moves by angle are no motion, infinite ones saturate. The state is that of the exact form. Temporaries: 16 KiB of stack in
 * an optimised build.
 */
typedef struct {
    double sigma0;          /* N m/rad */
    double Fc;              /* N m */
    double theta_per_count; /* rad/count, by counts not 0; not read by angle */
} dahl_throughput_params_t;

dahl_err_t dahl_throughput_counts(const dahl_throughput_params_t *params, dahl_state_t *state, const int32_t *dcounts, float *F,
                                  size_t n);
dahl_err_t dahl_throughput(const dahl_throughput_params_t *params, dahl_state_t *state, const float *dtheta, float *F,
                           size_t n);
dahl_err_t dahl_throughput_counts_channels(const dahl_throughput_params_t *params, dahl_state_t *states, size_t channels,
                                           const int32_t *dcounts, float *F, size_t n);
dahl_err_t dahl_throughput_channels(const dahl_throughput_params_t *params, dahl_state_t *states, size_t channels,
                                    const float *dtheta, float *F, size_t n);

/*
 * Throughput of elements in parallel, any mix of Dahl and slip elements (dahl_parts.h): in double, in vectors, rounded once.
 * Error: 0.5001 ulp of the sum of Fc for slip elements, DAHL_ULP_COUNTS ulp of it for any mix, without end. Limits and codes are
 * those of dahl_throughput_counts for each element; on a code nothing is touched. No element at all gives 0 N m. Temporaries:
 * 40 KiB of stack.
 */
typedef struct {
    dahl_throughput_params_t params;
    int32_t slips;       /* 0: Dahl's model; 1: a spring of stiffness sigma0 that slips at Fc */
    dahl_state_t state;  /* of Dahl's model, that of the exact form; 0 is relaxed */
    double x;            /* of a slip element, its deflection in counts; 0 is relaxed */
} dahl_throughput_element_t;

dahl_err_t dahl_throughput_parallel_counts(dahl_throughput_element_t *elements, size_t count, const int32_t *dcounts, float *F,
                                           size_t n);

#ifdef __cplusplus
}
#endif

#endif

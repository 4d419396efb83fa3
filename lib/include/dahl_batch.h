/* SPDX-License-Identifier: MIT */
/**
 * @file dahl_batch.h
 * @brief Process long logs on a host: n ticks in, n torques out.
 *
 * Use dahl_batch_... to verify: these calls are plain loops over the steps of a firmware, with
 * their bits and their speed. Use dahl_throughput_... for speed; the error bounds are the same.
 *
 * All calls write F [N m] and advance the states by n ticks. They allocate no memory. Arrays must
 * not overlap. If n or the number of channels is 0, a call does nothing. States are clamped first,
 * as in dahl.h.
 *
 * @par Channels
 * Many trajectories, tick after tick: move and torque t of channel c are at [t * channels + c];
 * plans[c], params[c] and states[c] belong to it.
 */
#ifndef DAHL_BATCH_H
#define DAHL_BATCH_H

#include <stddef.h>
#include "dahl.h"
#include "dahl_parts.h"

#ifdef __cplusplus
extern "C" {
#endif

/**
 * @name Exact
 * The bits of single steps, to verify a log.
 */
/** @{ */
/** dahl_step_counts() for each tick: F[t] [N m] from dcounts[t] [counts]. */
void dahl_batch_counts(const dahl_plan_t *plan, dahl_state_t *state, const int32_t *dcounts,
                       float *F, size_t n);
/** dahl_step() for each tick: F[t] [N m] from dtheta[t] [rad]. */
void dahl_batch(const dahl_plan_t *plan, dahl_state_t *state, const float *dtheta, float *F,
                size_t n);
/** dahl_step_counts() for each tick of each channel. */
void dahl_batch_counts_channels(const dahl_plan_t *plans, dahl_state_t *states, size_t channels,
                                const int32_t *dcounts, float *F, size_t n);
/** dahl_step() for each tick of each channel. */
void dahl_batch_channels(const dahl_plan_t *plans, dahl_state_t *states, size_t channels,
                         const float *dtheta, float *F, size_t n);
/** @} */

/** @name Elements of dahl_parts.h, exact */
/** @{ */
/** Return DAHL_PART(plan, state), for callers from other languages. */
dahl_part_t dahl_batch_part(const dahl_plan_t *plan, dahl_state_t *state);
/** Return DAHL_SLIP_PART(plan, state), for callers from other languages. */
dahl_part_t dahl_batch_slip_part(const dahl_slip_plan_t *plan, dahl_slip_state_t *state);
/** dahl_slip_step_counts() for each tick. */
void dahl_batch_slip_counts(const dahl_slip_plan_t *plan, dahl_slip_state_t *state,
                            const int32_t *dcounts, float *F, size_t n);
/** dahl_parallel_step_counts() for each tick. */
void dahl_batch_parallel_counts(const dahl_part_t *parts, uint32_t count, const int32_t *dcounts,
                                float *F, size_t n);
/** dahl_batch_NAME_counts(): dahl_NAME_step_counts() for each tick, of DAHL_BRISTLE_MODELS. */
#define DAHL_BATCH_COUNTS(name, ...) \
    void dahl_batch_##name##_counts(const dahl_##name##_plan_t *plan, dahl_state_t *state, \
                                    const int32_t *dcounts, float *F, size_t n);
DAHL_BRISTLE_MODELS(DAHL_BATCH_COUNTS)
/** dahl_loaded_step_counts() for each tick, with the load load_q30[t]. */
void dahl_batch_loaded_counts(const dahl_plan_t *plan, dahl_loaded_state_t *state,
                              const int32_t *dcounts, const uint32_t *load_q30, float *F, size_t n);
/** dahl_work_step_counts() for each tick. */
void dahl_batch_work_counts(const dahl_plan_t *plan, dahl_state_t *state, dahl_work_t *work,
                            const int32_t *dcounts, float *F, size_t n);
/** dahl_velocity_torque() for each tick. */
void dahl_batch_velocity(const dahl_velocity_plan_t *plan, const int32_t *dcounts, float *F,
                         size_t n);
/** @} */

/**
 * @name Throughput
 * The same recurrence in double, with vectors. Each call selects AVX-512, AVX2 or plain code by the
 * processor, so the bits depend on it. Channels run in groups of 16: fill a group, or use single
 * trajectories for a few. Error for any n:
 * #DAHL_ULP_COUNTS ulp of Fc by counts, and by angle if each |u| is 0 or at least 2^-30.
 *
 * There is no plan: parameters are double, with the limits and error codes of dahl_prepare(). If a
 * call fails, it writes nothing. An infinite angle saturates; a NaN is no motion, as is a
 * subnormal one if the caller has set DAZ in MXCSR. States are those of the exact form. The error
 * holds for rounding to nearest. Stack, if optimized: 16 KiB; with AVX2 by counts 65 KiB, for
 * channels 22 KiB.
 */
/** @{ */

/** Parameters of one Dahl element. */
typedef struct {
    double sigma0;          /**< [N m/rad] stiffness at rest */
    double Fc;              /**< [N m] Coulomb torque */
    double theta_per_count; /**< [rad/count] must not be 0 by counts; not read by angle */
} dahl_throughput_params_t;

/** Move by counts. @return #DAHL_OK, #DAHL_ERR_PARAM or #DAHL_ERR_RANGE */
dahl_err_t dahl_throughput_counts(const dahl_throughput_params_t *params, dahl_state_t *state,
                                  const int32_t *dcounts, float *F, size_t n);
/** Move by angles. @return #DAHL_OK, #DAHL_ERR_PARAM or #DAHL_ERR_RANGE */
dahl_err_t dahl_throughput(const dahl_throughput_params_t *params, dahl_state_t *state,
                           const float *dtheta, float *F, size_t n);
/** Move channels by counts. @return #DAHL_OK, or the error of a channel */
dahl_err_t dahl_throughput_counts_channels(const dahl_throughput_params_t *params,
                                           dahl_state_t *states, size_t channels,
                                           const int32_t *dcounts, float *F, size_t n);
/** Move channels by angles. @return #DAHL_OK, or the error of a channel */
dahl_err_t dahl_throughput_channels(const dahl_throughput_params_t *params, dahl_state_t *states,
                                    size_t channels, const float *dtheta, float *F, size_t n);
/** @} */

#ifdef __cplusplus
}
#endif

#endif

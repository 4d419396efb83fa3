/* SPDX-License-Identifier: MIT */
/**
 * @file dahl_float.h
 * @brief Textbook form of Dahl's model: a float exponential and a branch at each reversal.
 *
 * Use it to read, teach and cross-check. It solves Eq. 1 from the last reversal (Eqs. 7, 18, 27).
 * It needs libm (expm1f), whose bits differ between platforms, and float hardware to be fast.
 *
 * @par Error of F
 * With E = #DAHL_FLOAT_ERROR of Fc, each reversal adds an error that decays with travel:
 * @code{.text}
 *   E (1 + sum over past reversals of exp(-travel u since the reversal))
 * @endcode
 * Sweeps have 1 E or 2 E. Moves of 2 counts forward and 1 back, at u = 1e-6 per count, reach 6e5 E.
 * dahl.h has no such term.
 *
 * Without a reversal the error stays E for any number of steps, because travel is summed in
 * integers:
 * - By counts the sum is exact. If it would exceed 2^32 in one direction, the torque is rounded
 *   once, as at a reversal.
 * - By angle the unit is 2^-57 presliding lengths. E holds forever if each step has u >= 2^-33,
 *   otherwise for 2^32 steps in one direction. A step below one unit counts as no motion.
 *
 * @par Derivation of E, in units of 2^-24
 * Four roundings of u (a, theta or travel, their product, the sum) contribute at most 2 u exp(-u)
 * <= 0.74 each. expm1f with up to 1 ulp of g <= 1 is multiplied by |s - w| <= 2. Two final
 * roundings follow. The worst error in the tests is 0.82 E. With -ffast-math E still holds, but a
 * NaN is no longer ignored.
 */
#ifndef DAHL_FLOAT_H
#define DAHL_FLOAT_H

#include "dahl.h"

#ifdef __cplusplus
extern "C" {
#endif

/** [Fc] Torque error without reversals: 5 units of 2^-24. */
#define DAHL_FLOAT_ERROR 3e-7

/** Prepared parameters. */
typedef struct {
    float Fc;          /**< [N m] Coulomb torque */
    float a;           /**< [1/rad] sigma0/Fc */
    float a_per_count; /**< [1] travel of one count */
} dahl_float_plan_t;

/** State. All zeros: relaxed, no motion yet. Every call first clamps it, so any bits are a safe
 * state. */
typedef struct {
    float w_reversal;  /**< [1] F/Fc at the last reversal, -1 .. 1 */
    uint32_t counts;   /**< [counts] travel since the reversal, by counts */
    uint64_t travel;   /**< [Q57 presliding lengths] travel since the reversal, by angle, at most
                            2^62 */
    int32_t direction; /**< +1 or -1; 0 before the first motion */
} dahl_float_state_t;

/** As dahl_prepare(): same units, limits and error codes. */
DAHL_NODISCARD dahl_err_t dahl_float_prepare(dahl_float_plan_t *plan, const dahl_params_t *params);
/** As dahl_step_counts(), with the error bound of this header. */
float dahl_float_step_counts(const dahl_float_plan_t *plan, dahl_float_state_t *state,
                             int32_t dcounts);
/** As dahl_step(), with the error bound of this header. */
float dahl_float_step(const dahl_float_plan_t *plan, dahl_float_state_t *state, float dtheta);

#ifdef __cplusplus
}
#endif

#endif

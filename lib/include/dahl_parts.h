/* SPDX-License-Identifier: MIT */
/**
 * @file dahl_parts.h
 * @brief Elements that extend Dahl's model, elements in parallel, work and inverse.
 *
 * Use it if one Dahl element does not fit a measured bearing or gear; docs/parts.md helps to
 * choose. As in dahl.h, prepare once, then step in every tick.
 *
 * @par Guarantee
 * - By counts, a torque in N m is within #DAHL_ULP_PARTS = 0.55 ulp of Fc of the exact solution;
 *   of Stribeck friction, within #DAHL_ULP_STRIBECK. For several elements, read the sum of Fc. The
 *   bound holds for any motion, number of ticks and sampling rate.
 * - As in dahl.h: equal bits everywhere, no heap, no global variable, no libm, no division by a
 *   variable in a step.
 * - A state of all zeros is relaxed. A plan of all zeros moves nothing and gives 0 N m.
 * - An element that is not called is not linked.
 *
 * @par Properties
 * docs/parts.md lists the properties of the exact solution that each element keeps. Rounding has
 * these effects on properties that are not kept bit for bit:
 * - A closed cycle returns at most #DAHL_ENERGY_ERROR of Fc (under a load c above 1: of c Fc) times
 *   its path length, plus 2^-59 Fc^2/sigma0 for each tick by angle.
 * - The opposite motion gives the opposite torque, except at a tie: a w whose low 32 bits are 2^31
 *   rounds up in both directions. A tick from a tie then differs by at most 2^-30 of Fc, and later
 *   torques by at most twice their error.
 * - A longer move by counts ends at most #DAHL_MONOTONE_ERROR of Fc short of a shorter move from
 *   the same state, before it is rounded to a float.
 *
 * @par States
 * As in dahl.h, every call first clamps the state, so any bits of a state are safe. A plan must be
 * prepared or all zeros. If an element continues with the dahl_state_t of another, it keeps w, not
 * F.
 *
 * @par Power cycle
 * dahl_torque() and dahl_set_torque() also save and restore an elasto-plastic element (with
 * &plan.plastic), and the state of dahl_clamped_step() up to Fc. For other elements, store the
 * state with a checksum.
 *
 * Units, sign, threads, costs and hidden reversals: as in dahl.h.
 */
#ifndef DAHL_PARTS_H
#define DAHL_PARTS_H

#include <stddef.h>

#include "dahl.h"

/** [ulp of (the sum of) Fc] Torque error of every element and of any mix. */
#define DAHL_ULP_PARTS 0.55
/** [Fc times path length] Energy that rounding may add in a closed cycle. */
#define DAHL_ENERGY_ERROR 3.3e-9
/** [Fc times path length] The same by counts, except for an elasto-plastic element. */
#define DAHL_ENERGY_ERROR_COUNTS 1e-9
/** [Fc] Amount by which the rounding of w may shorten a longer move. */
#define DAHL_MONOTONE_ERROR 5.5e-9

#ifdef __cplusplus
extern "C" {
#endif

/**
 * @name Slip elements (Maxwell slip, Prandtl-Ishlinskii)
 * Each element is a spring of stiffness sigma0 that slips at the torque Fc: dF/dtheta = sigma0 if
 * |F| < Fc, otherwise F = +-Fc. This is Dahl's model with the exponent 0. The torques add. Several
 * elements remember each reversal until a larger one erases it, as rolling bearings do (Rizos and
 * Fassois 2004; Al-Bender's GMS without velocity).
 */
/** @{ */

/** Largest number of slip elements in a plan. */
#define DAHL_SLIP_MAX 8
/** [1] Error of F / sum of Fc of dahl_slip_step_counts_q30(); 1.52e-9 with one element. */
#define DAHL_SLIP_ERROR_Q30 3.15e-9

/** Parameters of slip elements. */
typedef struct {
    uint32_t elements;           /**< 1 .. DAHL_SLIP_MAX; further array entries are not read */
    float theta_per_count;       /**< [rad/count] 2^-64 <= theta_per_count < 2^64 */
    float sigma0[DAHL_SLIP_MAX]; /**< [N m/rad] stiffness of each element, range as in
                                      dahl_params_t */
    float Fc[DAHL_SLIP_MAX];     /**< [N m] torque at which it slips, range as in dahl_params_t */
} dahl_slip_params_t;

/** One element of a slip plan. Each element has its own unit of deflection. */
typedef struct {
    uint32_t limit;  /**< [unit] deflection at which it slips, 2^30 .. 2^31 - 1 */
    uint32_t weight; /**< torque of one unit, in 2^-62 of the sum of Fc */
} dahl_slip_element_t;

/** Prepared slip elements; may be `const` in flash. */
typedef struct {
    uint64_t full;                              /**< torque of all elements at their limits,
                                                     about 2^62; 0 in a plan of all zeros */
    uint32_t Fc_mantissa;                       /**< sum of Fc = Fc_mantissa 2^Fc_exponent [N m],
                                                     rounded up; top bit set */
    int32_t Fc_exponent;                        /**< exponent of Fc_mantissa */
    uint32_t elements;                          /**< number of elements */
    dahl_slip_element_t element[DAHL_SLIP_MAX]; /**< the elements */
    uint8_t shift[DAHL_SLIP_MAX];               /**< 2^shift units are one count */
} dahl_slip_plan_t;

/** State of slip elements. */
typedef struct {
    int32_t x[DAHL_SLIP_MAX]; /**< [unit] deflection of each element, -limit .. limit; 0 is
                                   relaxed */
} dahl_slip_state_t;

/**
 * Prepare slip elements.
 * @param[out] plan   plan to write; unchanged if the call fails
 * @param      params parameters
 * @return #DAHL_OK, or why a parameter, or the travel sigma0/Fc theta_per_count of one count, is
 *   rejected for an element. theta_per_count = 0 is #DAHL_ERR_PARAM: there is no step by angle.
 */
DAHL_NODISCARD dahl_err_t dahl_slip_prepare(dahl_slip_plan_t *plan,
                                            const dahl_slip_params_t *params);

/**
 * Move slip elements by counts and return the torque.
 * @param plan    prepared plan
 * @param state   state to move; 0 counts leave it bit-identical
 * @param dcounts [counts] signed move, any int32_t
 * @return F [N m]. If all elements slip, it is the sum of Fc, if a float can represent it.
 * @note Error: #DAHL_ULP_PARTS ulp of the sum of Fc, 0.522 with one element.
 * @note Cost: the same for any move, and more with each element.
 */
float dahl_slip_step_counts(const dahl_slip_plan_t *plan, dahl_slip_state_t *state,
                            int32_t dcounts);

/**
 * Move slip elements as dahl_slip_step_counts() does. Integers only.
 * @return F / sum of Fc in Q30, -2^30 .. 2^30, a half rounded up
 * @note Error: #DAHL_SLIP_ERROR_Q30.
 */
int32_t dahl_slip_step_counts_q30(const dahl_slip_plan_t *plan, dahl_slip_state_t *state,
                                  int32_t dcounts);
/** @} */

/**
 * @name Any mix in parallel
 * Elements on one shaft, whose torques add.
 * @code{.c}
 *   static const dahl_part_t parts[] = {DAHL_PART(&plan, &bearing), DAHL_SLIP_PART(&slips, &seal)};
 *   F = dahl_parallel_step_counts(parts, 2, dcounts);   // each tick
 * @endcode
 */
/** @{ */

/** One part of a mix. Initialize it with DAHL_PART() or DAHL_SLIP_PART(). */
typedef struct {
    /** Moves the part by counts and returns F/Fc in Q62. */
    int64_t (*move)(const void *plan, void *state, int32_t dcounts);
    const void *plan; /**< prepared plan of the part */
    void *state;      /**< state of the part */
    uint32_t Fc;      /**< [byte] offset of the mantissa of Fc in the plan; its exponent follows */
} dahl_part_t;

/** Initializer of a part: a Dahl element. The compiler rejects other plans and states. */
#define DAHL_PART(plan, state) \
    {dahl_part_move, &(plan)->a_mantissa, &(state)->w, offsetof(dahl_plan_t, Fc_mantissa)}
/** Initializer of a part: slip elements. */
#define DAHL_SLIP_PART(plan, state) \
    {dahl_slip_part_move, &(plan)->full, &(state)->x[0], offsetof(dahl_slip_plan_t, Fc_mantissa)}

/** Move a Dahl element and return F/Fc in Q62, for DAHL_PART(). */
int64_t dahl_part_move(const void *plan, void *state, int32_t dcounts);
/** Move slip elements and return F / sum of Fc in Q62, for DAHL_SLIP_PART(). */
int64_t dahl_slip_part_move(const void *plan, void *state, int32_t dcounts);

/**
 * Move all parts by counts and return the sum of their torques, rounded once.
 * @param parts   parts; their states are moved
 * @param count   number of parts; if it is 0, the torque is 0 N m
 * @param dcounts [counts] signed move, any int32_t
 * @return sum of F [N m]
 * @note Error: #DAHL_ULP_PARTS ulp of the sum of all Fc, for up to 10000 parts; 0.52 ulp if all are
 *   Dahl elements.
 */
float dahl_parallel_step_counts(const dahl_part_t *parts, uint32_t count, int32_t dcounts);

/**
 * Compute the share of each part in the sum of Fc, for dahl_parallel_step_counts_q30(). Call it
 * again if a plan changes.
 * @param[out] shares [Q31] negative shares with the sum -2^31; 0 for a plan of all zeros
 * @param      parts  parts
 * @param      count  number of parts and shares
 */
void dahl_parallel_shares(int32_t *shares, const dahl_part_t *parts, uint32_t count);

/** [1] Error of dahl_parallel_step_counts_q30(): the largest Q30 error of the parts, plus 2^-31 for
 * each part. */
#define DAHL_PARALLEL_ERROR_Q30(parts) (DAHL_SLIP_ERROR_Q30 + 4.66e-10 * (parts))

/**
 * Move all parts by counts. Integers only.
 * @param parts   parts; their states are moved
 * @param shares  shares of the same parts; if all are 0, the result is 0
 * @param count   number of parts
 * @param dcounts [counts] signed move, any int32_t
 * @return F / sum of Fc in Q30, a half rounded up; +-2^30 if all parts are at Fc. dahl_to_units()
 *   converts it.
 * @note Error: DAHL_PARALLEL_ERROR_Q30(count).
 */
int32_t dahl_parallel_step_counts_q30(const dahl_part_t *parts, const int32_t *shares,
                                      uint32_t count, int32_t dcounts);
/** @} */

/** @name Work of a Dahl element */
/** @{ */

/** Sums for the work of a Dahl element. Start with all zeros. */
typedef struct {
    uint32_t counts[3]; /**< [counts] distance travelled, lowest word first */
    uint32_t way[4];    /**< [Q62] path of w = F/Fc in the direction of travel, lowest word first */
} dahl_work_t;

/**
 * Move as dahl_step_counts() does and add up the work.
 */
float dahl_work_step_counts(const dahl_plan_t *plan, dahl_state_t *state, dahl_work_t *work,
                            int32_t dcounts);

/**
 * Move as dahl_step_counts_q30() does and add up the work.
 */
int32_t dahl_work_step_counts_q30(const dahl_plan_t *plan, dahl_state_t *state, dahl_work_t *work,
                                  int32_t dcounts);

/**
 * Return the work so far, the sum of F dtheta along the path (Eq. 1, integrated).
 * @param params parameters from which the plan was prepared
 * @param work   sums
 * @return [J] energy that the element absorbed; infinite above the largest float, 0 below the least
 *   normal one. It is negative only by the energy stored at the start, F^2/(2 sigma0), and by
 *   rounding: 1e-9 of Fc times the path length.
 * @note Error after R reversals: half an ulp of the result, plus 2^-59 of Fc times the path length,
 *   plus (R + 1/2) times 1.5e-9 of Fc^2/sigma0. If a count travels 4e-8 or more, read 9.5e-10.
 */
float dahl_work(const dahl_params_t *params, const dahl_work_t *work);
/** @} */

/** @name Inverse: counts from a torque */
/** @{ */

/** [Fc] Amount by which rounding may reorder moves in dahl_counts_to_torque(). */
#define DAHL_INVERSE_ERROR 1.5e-9

/**
 * Find a move after which dahl_step_counts() returns F, or a torque beyond F as seen from the
 * present one. A move of one count less does not reach F.
 *
 * Except for rounding, it is the least such move. A shorter move that reaches F passes it by less
 * than #DAHL_INVERSE_ERROR of Fc, and is shorter by at most 1 + DAHL_INVERSE_ERROR/(u p) counts. u
 * is the travel of one count. p is the gap from F to Fc in the direction of the move, as a fraction
 * of Fc, at least 2^-25. Examples: 0.05/u counts at F = Fc, 3e-9/u at Fc/2.
 *
 * @param      plan    prepared plan
 * @param      state   present state; unchanged
 * @param      F       [N m] torque to reach, -Fc .. Fc
 * @param[out] dcounts [counts] signed move; 0 if F is the present torque. Unchanged if the call
 *   fails.
 * @return #DAHL_OK; #DAHL_ERR_PARAM if F is NaN or infinite; #DAHL_ERR_RANGE if F is beyond Fc, or
 *   if a move of 2^31 - 1 counts does not reach it
 * @note Cost: a search. If counts change the torque by less than its rounding, up to 62 moves.
 */
DAHL_NODISCARD dahl_err_t dahl_counts_to_torque(const dahl_plan_t *plan, const dahl_state_t *state,
                                                float F, int32_t *dcounts);

/**
 * Return the torque at the tips of the steady loop of a constant stroke.
 * @param plan   prepared plan
 * @param stroke [counts] distance between the two ends
 * @return [N m] Fc tanh(u/2), u the travel of the stroke
 * @note Error: 2^-30 of the result, and one rounding.
 */
float dahl_tip_torque(const dahl_plan_t *plan, uint32_t stroke);
/** @} */

/**
 * @name Friction that depends on speed (viscous, Stribeck)
 * An odd table over the counts per tick. It is independent of the path: add its torque to that of
 * an element. Viscous friction is a straight line, Stribeck friction a table that falls. Only a
 * negative value feeds energy into the motion.
 */
/** @{ */

/** Number of segments of the table. */
#define DAHL_VELOCITY_SEGMENTS 16

/** Parameters of the table. */
typedef struct {
    uint32_t segment_bits;                /**< 0 .. 24: a segment is 2^segment_bits counts per
                                               tick */
    float torque[DAHL_VELOCITY_SEGMENTS]; /**< [N m] at (k + 1) 2^segment_bits counts forward; 0,
                                               or 2^-64 <= |torque| < 2^64. Linear in between, 0
                                               at rest, the negative backward, the last value
                                               beyond the end. */
} dahl_velocity_params_t;

/** Prepared table; may be `const` in flash. */
typedef struct {
    uint32_t segment_bits;                         /**< as in dahl_velocity_params_t */
    uint32_t torque_mantissa;                      /**< largest |torque| = torque_mantissa
                                                        2^torque_exponent [N m] */
    int32_t torque_exponent;                       /**< exponent of torque_mantissa */
    int32_t ratio_q30[DAHL_VELOCITY_SEGMENTS + 1]; /**< torque over the largest one, from 0 at
                                                        rest to the end of each segment */
} dahl_velocity_plan_t;

/**
 * Prepare the table.
 * @param[out] plan   plan to write; unchanged if the call fails
 * @param      params parameters
 * @return #DAHL_OK; #DAHL_ERR_PARAM if a torque is NaN or infinite; #DAHL_ERR_RANGE if a value is
 *   out of range
 */
DAHL_NODISCARD dahl_err_t dahl_velocity_prepare(dahl_velocity_plan_t *plan,
                                                const dahl_velocity_params_t *params);

/**
 * Return the torque at a speed.
 * @param plan    prepared plan; if it is all zeros, the torque is 0
 * @param dcounts [counts per tick] signed speed, any int32_t
 * @return torque [N m]
 * @note Error: 1.5 2^-30 of the largest torque, and one rounding.
 */
float dahl_velocity_torque(const dahl_velocity_plan_t *plan, int32_t dcounts);

/**
 * Return the torque at a speed. Integers only.
 * @return torque over the largest |torque|, in Q30
 */
int32_t dahl_velocity_torque_q30(const dahl_velocity_plan_t *plan, int32_t dcounts);

/**
 * @name Presliding damping
 * For a motor that renders friction: a knob, a wheel of a simulator. The element alone is a spring
 * in presliding. The motor acts on it late, so a shaft that rests buzzes. LuGre's sigma1 damps it.
 * @code{.c}
 *   // y = F + sigma1/sigma0 dF/dt  [N m], with dF of a tick: it changes by travel only
 *   w = dahl_step_counts_q30(&plan, &state, dcounts);
 *   command_mNm = -dahl_to_units(dahl_damping_apply(&damping_plan, &damping, w), Fc_mNm);
 * @endcode
 * Choose sigma1 = 2 zeta sqrt(inertia sigma0) in N m s/rad, zeta 0.2 to 0.3; inertia: all that the
 * motor turns. A free shaft then rests within 2 counts if
 * - sqrt(sigma0/inertia) (delay + period) <= 0.4, delay from reading to torque: lower sigma0,
 * - a count of the encoder is at most Fc/(5 sigma0): lower sigma0, or use a finer encoder.
 *
 * With noise of +-1 count it rests within 10 counts if a count is at most Fc/(20 sigma0). Do not
 * put the counts behind a play: it delays the torque, and the shaft buzzes again. docs/rendering.md
 * has the largest sigma0 for an inertia, a tick and a delay.
 */
/** @{ */

/** Prepared damping; may be `const` in flash. All zeros: no damping. */
typedef struct {
    int32_t gain_q16; /**< [Q16] sigma1/(sigma0 period), above 0 */
} dahl_damping_plan_t;

/** State of the damping. All zeros: a relaxed element. After a jump of the element's state, set it
 * to the torque of the element. */
typedef struct {
    int32_t ratio_q30; /**< [Q30 of Fc] torque of the element in the last tick */
} dahl_damping_t;

/**
 * Prepare the damping.
 * @param[out] plan   plan to write; unchanged if the call fails
 * @param      params parameters of the element: its steepest sigma0
 * @param      sigma1 [N m s/rad] damping, 2^-64 <= sigma1 < 2^64
 * @param      period [s] time between two ticks, 2^-64 <= period < 2^64
 * @return #DAHL_OK; #DAHL_ERR_PARAM if a value is NaN, infinite, zero or negative; #DAHL_ERR_RANGE
 *   if one is out of range, or sigma1/(sigma0 period) is outside 2^-16 .. 32767
 */
DAHL_NODISCARD dahl_err_t dahl_damping_prepare(dahl_damping_plan_t *plan,
                                               const dahl_params_t *params, float sigma1,
                                               float period);

/**
 * Add the damping to the torque of the element. Call it once in each tick.
 * @param plan      prepared plan
 * @param damping   state
 * @param ratio_q30 [Q30 of Fc] torque of the element, any int32_t
 * @return [Q30 of Fc] ratio_q30 and its change times sigma1/(sigma0 period), within 2 Fc
 */
int32_t dahl_damping_apply(const dahl_damping_plan_t *plan, dahl_damping_t *damping,
                           int32_t ratio_q30);
/** @} */
/** @} */

/**
 * @name Asymmetric friction
 * One Fc for each direction, as under a preload, at a seal, or in a gear with one worn flank.
 * @code{.text}
 *   forward    dF/dtheta = sigma0 (1 - F/Fc_forward)
 *   backward   dF/dtheta = sigma0 (1 + F/Fc_backward)
 * @endcode
 * With m = (Fc_forward - Fc_backward)/2 and h = (Fc_forward + Fc_backward)/2, this is F = m + h w:
 * Dahl's model with a different presliding length Fc/sigma0 for each direction. Relaxed is F = 0,
 * not w = 0. Two values of sigma0 could create energy in a closed cycle.
 */
/** @{ */

/** [1] Error of F / larger Fc of dahl_asymmetric_step_counts_q30(). */
#define DAHL_ASYMMETRIC_ERROR_Q30 1.41e-9

/** Parameters of asymmetric friction. */
typedef struct {
    float sigma0;          /**< [N m/rad] stiffness at F = 0 in both directions, range as in
                                dahl_params_t */
    float Fc_forward;      /**< [N m] F after a long move forward, range as in dahl_params_t */
    float Fc_backward;     /**< [N m] -F after a long move backward, same range */
    float theta_per_count; /**< [rad/count] 2^-64 <= theta_per_count < 2^64 */
} dahl_asymmetric_params_t;

/** Prepared asymmetric friction; may be `const` in flash. */
typedef struct {
    uint64_t end_forward;    /**< [Q62] Fc_forward over the larger Fc */
    uint64_t end_backward;   /**< [Q62] Fc_backward over the larger Fc */
    uint32_t Fc_mantissa;    /**< larger Fc = Fc_mantissa 2^Fc_exponent [N m]; top bit set */
    int32_t Fc_exponent;     /**< exponent of Fc_mantissa */
    dahl_q64_t forward[23];  /**< g of 0, 1 .. 8 counts, then of 32, 128 .. 2^31 counts */
    dahl_q64_t backward[23]; /**< the same for backward moves */
} dahl_asymmetric_plan_t;

/** State of asymmetric friction: w = F / larger Fc. */
typedef dahl_state_t dahl_asymmetric_state_t;

/**
 * Prepare asymmetric friction.
 * @param[out] plan   plan to write; unchanged if the call fails
 * @param      params parameters
 * @return #DAHL_OK, or why a parameter, or the travel sigma0/Fc theta_per_count of one count, is
 *   rejected for either Fc. theta_per_count = 0 is #DAHL_ERR_PARAM: there is no step by angle.
 */
DAHL_NODISCARD dahl_err_t dahl_asymmetric_prepare(dahl_asymmetric_plan_t *plan,
                                                  const dahl_asymmetric_params_t *params);

/**
 * Move by counts and return the torque.
 * @param plan    prepared plan
 * @param state   state to move, w = F / larger Fc; 0 counts leave it bit-identical
 * @param dcounts [counts] signed move, any int32_t
 * @return F [N m], -Fc_backward .. Fc_forward; it exceeds the smaller of the two by at most the
 *   error
 * @note Error: #DAHL_ULP_PARTS ulp of the larger Fc.
 */
float dahl_asymmetric_step_counts(const dahl_asymmetric_plan_t *plan, dahl_state_t *state,
                                  int32_t dcounts);

/**
 * Move as dahl_asymmetric_step_counts() does. Integers only.
 * @return F / larger Fc in Q30, a half rounded up
 * @note Error: #DAHL_ASYMMETRIC_ERROR_Q30.
 */
int32_t dahl_asymmetric_step_counts_q30(const dahl_asymmetric_plan_t *plan, dahl_state_t *state,
                                        int32_t dcounts);
/** @} */

/**
 * @name Load that scales Fc and sigma0
 * A factor c, given with each tick: normal force, torque through a gear, preload or temperature. Fc
 * and sigma0 both scale with c, so one plan serves all loads. If the load falls, the bristle keeps
 * its deflection and F falls with c. If it grows, F is kept: to keep the deflection would create
 * energy, 0.066 Fc^2/sigma0 in random cycles. A tick first applies its load, then moves. At c = 1
 * the torque has the bits of dahl_step_counts().
 */
/** @{ */

/** [1] Error of F/Fc of dahl_loaded_step_counts_q30(); 1.85e-9 if the load is 1 or less. */
#define DAHL_LOADED_ERROR_Q30 4.7e-9

/** State under a load. All zeros: relaxed, without load. */
typedef struct {
    dahl_state_t bristle; /**< w = F / (load Fc) */
    uint32_t load_q30;    /**< [Q30] load of the last tick */
} dahl_loaded_state_t;

/** Plan for the load 1, from dahl_prepare(). */
typedef dahl_plan_t dahl_loaded_plan_t;

/**
 * Move by counts under a load and return the torque.
 * @param plan     plan for the load 1, from dahl_prepare()
 * @param state    state to move; the same load and 0 counts leave it bit-identical
 * @param dcounts  [counts] signed move, any int32_t
 * @param load_q30 [Q30] load c, below 2^31; a larger value counts as 2^31 - 1. If c = 0, F is 0,
 *   and the bristle relaxes when a load returns.
 * @return F [N m], -c Fc .. c Fc, the nearest float. If c Fc < 2^-64 N m, a torque below 2^-32 c Fc
 *   becomes 0.
 * @note Error: #DAHL_ULP_PARTS ulp of c Fc. Cost: more if the load grew.
 */
float dahl_loaded_step_counts(const dahl_plan_t *plan, dahl_loaded_state_t *state, int32_t dcounts,
                              uint32_t load_q30);

/**
 * Move as dahl_loaded_step_counts() does. Integers only.
 * @return F/Fc in Q30, between -2^31 and 2^31, a half rounded up
 * @note Error: #DAHL_LOADED_ERROR_Q30. Cost: more if the load grew.
 */
int32_t dahl_loaded_step_counts_q30(const dahl_plan_t *plan, dahl_loaded_state_t *state,
                                    int32_t dcounts, uint32_t load_q30);
/** @} */

/**
 * @name Load that scales Fc only
 * The other passive rule: Fc scales with the load c, sigma0 is constant. Use it if the stiffness is
 * that of the bearing, not that of its contacts. The presliding length changes with the load, so a
 * tick is by angle. If the load falls, F is clamped to c Fc. If it grows, F is kept. At c = 1 the
 * torque has the bits of dahl_step().
 */
/** @{ */

/**
 * Move by an angle under a load and return the torque. To read it at rest under a load above 1,
 * move by 0, since dahl_torque() clamps to +-Fc.
 * @param plan     plan for the load 1, from dahl_prepare(); if it is all zeros, the state is
 *   unchanged
 * @param state    state to move, w = F/Fc
 * @param dtheta   [rad] signed move; NaN and infinity as in dahl_step()
 * @param load_q30 [Q30] load c, as in dahl_loaded_step_counts(). If it is 0, F is 0 and stays 0
 *   until the shaft moves under a load.
 * @return F [N m], -c Fc .. c Fc, exceeded by at most 2^-31 Fc and its rounding to float
 * @note Error: #DAHL_ULP_ANGLE ulp of Fc, or of c Fc if c > 1, if each travel u/c is 0 or at least
 *   2^-30; add up smaller moves before the call.
 */
float dahl_clamped_step(const dahl_plan_t *plan, dahl_state_t *state, float dtheta,
                        uint32_t load_q30);
/** @} */

/**
 * @name Elasto-plastic friction: no creep below breakaway
 * Source: Dupont, Hayward, Armstrong, Altpeter 2002; over space as in Hayward 2009. Up to F = b Fc
 * in the direction of motion, the bristle is a spring: dF/dtheta = sigma0. Beyond b it slides: the
 * gap p = 1 - |F|/Fc falls as exp(-kappa u). kappa = 1/(1 - b) makes the slope continuous at b.
 * With b near 0, the first loading is that of Dahl's model; with b near 1, that of a slip element.
 */
/** @{ */

/** [1] Error of F/Fc of dahl_elastoplastic_step_counts_q30(). */
#define DAHL_ELASTOPLASTIC_ERROR_Q30 3.1e-9

/** Prepared elasto-plastic element; may be `const` in flash. */
typedef struct {
    dahl_plan_t plastic;    /**< beyond b: Dahl's model with kappa sigma0; its a is kappa/ln 2
                                 per unit of travel */
    int64_t breakaway;      /**< [Q62] b */
    uint64_t travel[9];     /**< travel of 0 .. direct_counts counts in presliding lengths, Q62;
                                 if one count travels 2 or more, Q57 */
    uint32_t gap_q31;       /**< [Q31] 1 - b */
    uint32_t direct_counts; /**< moves up to this have an entry in travel; 8 or less */
    uint32_t counts_max;    /**< this many counts travel 1 to 2; 0 if one count travels more */
} dahl_elastoplastic_plan_t;

/** State of an elasto-plastic element: w = F/Fc. */
typedef dahl_state_t dahl_elastoplastic_state_t;

/**
 * Prepare an elasto-plastic element.
 * @param[out] plan      plan to write; unchanged if the call fails
 * @param      params    parameters
 * @param      breakaway [1] b, 0 < b < 1
 * @return #DAHL_OK, or why a parameter or the travel of one count is rejected. b >= 1 is
 *   #DAHL_ERR_RANGE; a b that is NaN, infinite, zero or negative, and theta_per_count = 0, are
 *   #DAHL_ERR_PARAM.
 */
DAHL_NODISCARD dahl_err_t dahl_elastoplastic_prepare(dahl_elastoplastic_plan_t *plan,
                                                     const dahl_params_t *params,
                                                     float breakaway);

/**
 * Move by counts and return the torque.
 * @param plan    prepared plan
 * @param state   state to move; 0 counts leave it bit-identical
 * @param dcounts [counts] signed move, any int32_t
 * @return F [N m], -Fc .. Fc
 * @note Error: #DAHL_ULP_PARTS ulp of Fc. Cost: more if the move crosses b.
 */
float dahl_elastoplastic_step_counts(const dahl_elastoplastic_plan_t *plan, dahl_state_t *state,
                                     int32_t dcounts);

/**
 * Move as dahl_elastoplastic_step_counts() does. Integers only.
 * @return F/Fc in Q30, -2^30 .. 2^30, a half rounded up
 * @note Error: #DAHL_ELASTOPLASTIC_ERROR_Q30. Cost: more if the move crosses b.
 */
int32_t dahl_elastoplastic_step_counts_q30(const dahl_elastoplastic_plan_t *plan,
                                           dahl_state_t *state, int32_t dcounts);
/** @} */

/**
 * @name Stribeck friction: a bristle whose Fc falls with speed
 * The law of LuGre (Canudas de Wit, Olsson, Astrom, Lischinsky 1995) without sigma1. Use it if
 * static friction exceeds sliding friction, so that a drive sticks and slips.
 * @verbatim
 *   Fc(v) = Fc + (Fs - Fc) exp(-(v/vs)^2)        vs: the Stribeck speed
 *   dF/dtheta = sigma0 (1 - s F/Fc(v))
 * @endverbatim
 * In a tick, Fc(v) is constant and the solution exact. v is the speed of the caller, or that of the
 * counts of the tick. Fs below Fc is allowed: friction then rises with speed.
 *
 * @par Passivity
 * sigma0 is constant. F is kept when Fc(v) changes, so a change of speed alone neither stores nor
 * releases energy. If |F| exceeds Fc(v), it returns to it over the travel Fc(v)/sigma0, and never
 * in a jump. The work of any motion at any speeds, true or not, is at least the change of
 * F^2/(2 sigma0), less #DAHL_ENERGY_ERROR_STRIBECK. F depends on speed, so split travel has the
 * same torque only at the same speed.
 */
/** @{ */

/** [ulp of the larger of Fs and Fc] Torque error. */
#define DAHL_ULP_STRIBECK 0.62
/** [1] Error of F over the larger of Fs and Fc of the calls that end with _q30. */
#define DAHL_STRIBECK_ERROR_Q30 6.6e-9
/** [larger of Fs and Fc, times path length] Energy that rounding may add. */
#define DAHL_ENERGY_ERROR_STRIBECK 5e-9

/** Parameters of Stribeck friction. */
typedef struct {
    float sigma0;          /**< [N m/rad] stiffness at F = 0, range as in dahl_params_t */
    float Fs;              /**< [N m] |F| after a long slow move, range as in dahl_params_t */
    float Fc;              /**< [N m] |F| after a long fast move, Fs/16 .. 16 Fs */
    float theta_per_count; /**< [rad/count] 2^-64 <= theta_per_count < 2^64 */
    float speed_travel;    /**< [rad] travel of a tick at the Stribeck speed: vs times the period of
                                ticks; 2^-64 <= speed_travel < 2^64, at least 4 theta_per_count.
                                Fewer counts could not tell slow from fast. 0: for the calls at a
                                speed alone; for the others, all moves are slow */
} dahl_stribeck_params_t;

/** Prepared Stribeck friction; may be `const` in flash. */
typedef struct {
    uint32_t slow_q32;       /**< [Q32] Fs over the larger of Fs and Fc; 1 as 2^32 - 1 */
    uint32_t fast_q32;       /**< [Q32] Fc over the larger of both */
    uint32_t a_mantissa;     /**< travel of one count, over ln 2, in presliding lengths of the
                                  larger of both; 0 in a plan of all zeros */
    int32_t a_exponent;      /**< exponent of a_mantissa */
    uint32_t speed_mantissa; /**< speed of one count per tick over vs, times sqrt(log2 e) */
    int32_t speed_exponent;  /**< exponent of speed_mantissa */
    uint32_t limit_mantissa; /**< larger of Fs and Fc [N m]; top bit set */
    int32_t limit_exponent;  /**< exponent of limit_mantissa */
} dahl_stribeck_plan_t;

/** State of Stribeck friction: w = F over the larger of Fs and Fc. */
typedef dahl_state_t dahl_stribeck_state_t;

/**
 * Prepare Stribeck friction.
 * @param[out] plan   plan to write; unchanged if the call fails
 * @param      params parameters
 * @return #DAHL_OK, or why a parameter, or the travel sigma0/Fc theta_per_count of one count, is
 *   rejected for Fs or Fc. theta_per_count = 0 is #DAHL_ERR_PARAM: there is no step by angle. A
 *   speed_travel below 4 theta_per_count is #DAHL_ERR_RANGE: give the speed in each call.
 */
DAHL_NODISCARD dahl_err_t dahl_stribeck_prepare(dahl_stribeck_plan_t *plan,
                                                const dahl_stribeck_params_t *params);

/**
 * Move by the counts of one tick, at the speed of these counts, and return the torque.
 * @param plan    prepared plan
 * @param state   state to move; 0 counts leave it bit-identical
 * @param dcounts [counts] signed move of one tick, any int32_t
 * @return F [N m], |F| at most the larger of Fs and Fc
 * @note Error: #DAHL_ULP_STRIBECK ulp of the larger of Fs and Fc. A move of n of the N counts of
 *   speed_travel has a speed of n/N: with N of 8 or more, one count is at most 2 % of Fs - Fc below
 *   Fs.
 */
float dahl_stribeck_step_counts(const dahl_stribeck_plan_t *plan, dahl_state_t *state,
                                int32_t dcounts);

/**
 * Move as dahl_stribeck_step_counts() does. Integers only.
 * @return F over the larger of Fs and Fc in Q30, -2^30 .. 2^30, a half rounded up
 * @note Error: #DAHL_STRIBECK_ERROR_Q30.
 */
int32_t dahl_stribeck_step_counts_q30(const dahl_stribeck_plan_t *plan, dahl_state_t *state,
                                      int32_t dcounts);

/**
 * Move by counts at a speed that the caller knows, from a filter, an observer or a tachometer.
 * @param plan      prepared plan
 * @param state     state to move; 0 counts leave it bit-identical
 * @param dcounts   [counts] signed move, any int32_t
 * @param speed_q20 [Q20 of vs] speed, any int32_t: 2^20 is the Stribeck speed. Its sign is ignored.
 * @return F [N m], |F| at most the larger of Fs and Fc
 * @note Error: #DAHL_ULP_STRIBECK ulp of the larger of Fs and Fc, for this speed.
 */
float dahl_stribeck_step_at_speed(const dahl_stribeck_plan_t *plan, dahl_state_t *state,
                                  int32_t dcounts, int32_t speed_q20);

/**
 * Move as dahl_stribeck_step_at_speed() does. Integers only.
 * @return F over the larger of Fs and Fc in Q30, -2^30 .. 2^30, a half rounded up
 * @note Error: #DAHL_STRIBECK_ERROR_Q30.
 */
int32_t dahl_stribeck_step_at_speed_q30(const dahl_stribeck_plan_t *plan, dahl_state_t *state,
                                        int32_t dcounts, int32_t speed_q20);
/** @} */

/**
 * @name Model chosen at run time
 * The calls of one model as a constant object, for a program that learns the model from a file or
 * an option. A firmware that knows its model calls dahl_NAME_step_counts() directly.
 * @code{.c}
 *   static dahl_any_plan_t plan;
 *   static dahl_any_state_t state;                                 // all zeros: relaxed
 *   const dahl_model_t *model = &dahl_model_slip;
 *   dahl_model_params_t params = {{2, 1e-4f, {100, 300}, {0.5f, 0.2f}}, 0, 0}; // two elements
 *   if (model->q30->prepare(&plan, &params) != DAHL_OK) { stop(); }
 *   F = model->step(&plan, &state, dcounts, 1u << 30);             // each tick; load 1
 * @endcode
 * Only the models that a program names are linked. Link with --gc-sections, so that
 * dahl_model_NAME_q30 links no float form.
 */
/** @{ */

/** The friction models: one row each. Nodes, simulators, log calls, scenes, the Python package,
 * dahl.dbc and the pages read this table.
 *
 *     MODEL(name, NAME, Class, number, sigma0s, Fcs, plan, key, meaning, low, high)
 *
 * - name: in scenes and options. Its types are dahl_name_plan_t and dahl_name_state_t, and its
 *   objects dahl_model_name and dahl_model_name_q30. Those of the Dahl element are dahl_plan_t,
 *   dahl_state_t, dahl_model_dahl and dahl_model_dahl_q30.
 * - NAME: DAHL_FRAMES_MODEL_NAME is its number.
 * - Class: in dahl.dbc and of the Python package, where the Dahl element is a Plan.
 * - number: value of parameter Model of a node. If sigma0s is 0, the node adds its number of
 *   elements.
 * - sigma0s: how many sigma0 [N m/rad]; 0: one for each of 1 .. DAHL_SLIP_MAX elements.
 * - Fcs: how many Fc [N m]; 0: one for each element; 2: one for each direction, or Fs and Fc. The
 *   torque ratio is F divided by the sum of all Fc. For 2, it is F divided by the larger one.
 * - plan: 1 if `dahl plan --model` can write its plan as a constant for flash.
 * - key: its own key in [friction] of a scene; "" if there is none.
 * - meaning: what that key sets, or other data that the model needs.
 * - low, high: both allowed values of the key if it is a number, which params.own then holds;
 *   otherwise 0, 0. */
/* clang-format off */
#define DAHL_OTHER_MODELS(MODEL) \
    MODEL(slip, SLIP, Slip, 0, 0, 0, 1, "", "", 0, 0) \
    MODEL(parallel, PARALLEL, Parallel, 32, 0, 0, 0, "kinds", "`dahl` or `slip` for each element", \
          0, 0) \
    MODEL(loaded, LOADED, Loaded, 18, 1, 1, 0, "", \
          "a section `[load]`; `sigma0` and `Fc` hold at load 1", 0, 0) \
    DAHL_BRISTLE_MODELS(MODEL)

/** Rows of the models with the state of one bristle, a dahl_state_t, and the calls
 * dahl_name_step_counts(plan, state, dcounts) and dahl_name_step_counts_q30(). Their log calls,
 * tests and benchmarks read these rows. */
#define DAHL_BRISTLE_MODELS(MODEL) \
    MODEL(elastoplastic, ELASTOPLASTIC, ElastoPlastic, 17, 1, 1, 1, "breakaway", \
          "the fraction of Fc up to which nothing creeps", 1e-45, 0.9999999403953552) \
    MODEL(asymmetric, ASYMMETRIC, Asymmetric, 16, 1, 2, 1, "", "", 0, 0) \
    MODEL(stribeck, STRIBECK, Stribeck, 19, 1, 2, 1, "stribeck", \
          "rad that a tick travels at the Stribeck speed", 1e-19, 1e+19)
/* clang-format on */

/** All models: the Dahl element and DAHL_OTHER_MODELS. */
#define DAHL_MODELS(MODEL) \
    MODEL(dahl, DAHL, Dahl, 0, 1, 1, 1, "", "", 0, 0) \
    DAHL_OTHER_MODELS(MODEL)

/** Parameters of any model. */
typedef struct {
    dahl_slip_params_t each; /**< theta_per_count, and sigma0 and Fc of each element. With two Fc
                                  and one sigma0, Fc[0] is forward and Fc[1] is backward, or Fc[0]
                                  is Fs and Fc[1] is Fc. Only
                                  models whose sigma0s is 0 read `elements` */
    uint32_t slips;          /**< only `parallel` reads it. Bit k set: element k slips, otherwise it
                                  is a Dahl element */
    float own;               /**< value of the model's own key */
} dahl_model_params_t;

/** Calls of a model. Ticks use integers only. A state of all zeros is relaxed. */
typedef struct {
    /** Prepares a plan. If a parameter is rejected, it returns the reason and leaves the plan
     * unchanged. The ranges are those of the model's own prepare function. */
    dahl_err_t (*prepare)(void *plan, const dahl_model_params_t *params);
    /** Moves by counts and returns the torque ratio in Q30. Only `loaded` reads load_q30, the load
     * as in dahl_loaded_step_counts(); 2^30 is load 1. */
    int32_t (*step_q30)(const void *plan, void *state, int32_t dcounts, uint32_t load_q30);
    uint16_t plan_bytes;  /**< [byte] size of the plan; the state may follow it directly */
    uint16_t state_bytes; /**< [byte] size of the state */
    uint8_t number;       /**< number in its row of DAHL_MODELS */
    uint8_t sigma0s;      /**< sigma0s in its row */
    uint8_t Fcs;          /**< Fcs in its row */
} dahl_model_q30_t;

/** Calls of a model. */
typedef struct {
    const dahl_model_q30_t *q30; /**< its calls in integers */
    /** Moves by counts and returns F [N m]. load_q30 as in step_q30. */
    float (*step)(const void *plan, void *state, int32_t dcounts, uint32_t load_q30);
} dahl_model_t;

/** Declares the objects of one model. */
#define DAHL_DECLARE_MODEL(name, ...) \
    extern const dahl_model_q30_t dahl_model_##name##_q30; \
    extern const dahl_model_t dahl_model_##name;
DAHL_MODELS(DAHL_DECLARE_MODEL)

/** Plan of the model `parallel`. */
typedef struct {
    uint32_t bearings;               /**< number of Dahl elements */
    dahl_slip_plan_t slip;           /**< plan of the slip elements */
    uint64_t slip_share;             /**< [Q62] share of the slip elements in the sum of Fc */
    dahl_plan_t plan[DAHL_SLIP_MAX]; /**< plans of the Dahl elements */
    uint64_t share[DAHL_SLIP_MAX];   /**< [Q62] shares of the Dahl elements */
} dahl_parallel_plan_t;

/** State of the model `parallel`. */
typedef struct {
    dahl_slip_state_t slip;            /**< state of the slip elements */
    dahl_state_t state[DAHL_SLIP_MAX]; /**< states of the Dahl elements */
} dahl_parallel_state_t;

/** Member of dahl_any_plan_t. */
#define DAHL_ANY_PLAN(name, ...) dahl_##name##_plan_t name;
/** Plan of any model. */
typedef union {
    dahl_plan_t dahl; /**< of the Dahl element */
    DAHL_OTHER_MODELS(DAHL_ANY_PLAN)
} dahl_any_plan_t;

/** Member of dahl_any_state_t. */
#define DAHL_ANY_STATE(name, ...) dahl_##name##_state_t name;
/** State of any model. Any bits are safe; all zeros are relaxed. */
typedef union {
    dahl_state_t dahl; /**< of the Dahl element */
    DAHL_OTHER_MODELS(DAHL_ANY_STATE)
} dahl_any_state_t;
/** @} */

#ifdef __cplusplus
}
#endif

#endif

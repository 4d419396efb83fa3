/* SPDX-License-Identifier: MIT */
/**
 * @file dahl.h
 * @brief Friction torque by Dahl's model, exact at every encoder tick.
 *
 * Use it to compute the friction of a bearing, gear or seal from encoder counts or angles. Call
 * dahl_prepare() once at start-up, then one of the step functions in every tick.
 * docs/microcontroller.md has the instructions, stack and flash of every call.
 *
 * @par Use
 * @code{.c}
 *   static dahl_plan_t plan;       // constant after dahl_prepare; may live in flash
 *   static dahl_state_t bearing;   // all zeros: relaxed
 *   dahl_params_t p = {100.0f, 0.5f, 6.2831853f / 16384};   // sigma0, Fc, theta of a count
 *   if (dahl_prepare(&plan, &p) != DAHL_OK) { stop(); }
 *   F = dahl_step_counts(&plan, &bearing, dahl_counts_between(before, now, 16384)); // each tick
 * @endcode
 *
 * @par Sign
 * F has the sign of the motion. The bearing acts on the shaft with -F; feed-forward compensation
 * adds +F.
 *
 * @par Guarantee
 * - If a state is moved by counts only, its torque is within #DAHL_ULP_COUNTS = 0.52 ulp of Fc of
 *   the exact solution of the model. The bound holds for any motion, number of ticks and sampling
 *   rate.
 * - If dahl_step() has moved the state, the bound of all later calls is #DAHL_ULP_ANGLE = 0.6 ulp
 *   of Fc. It refers to the float angles and counts fed so far.
 * - The same inputs give the same bits on every processor, compiler and set of flags. All
 *   calculations use integers.
 * - There is no heap, no global variable, no libm, and no division by a variable in a step.
 *
 * @par Model
 * Source: V. Ciarla, V. Cahouet, C. Canudas de Wit, F. Quaine, *Notes on the analytic solution for
 * the Dahl's friction model*, Laboratoire d'Automatique de Grenoble, project VolHand
 * (ANR-09-VTT-14). The equation numbers are theirs; docs/model.md lists the errata. For linear
 * motion, read m for rad and N for N m.
 * @code{.text}
 *   dF/dtheta = sigma0 (1 - F/Fc sgn(dtheta))                                         (Eq. 1)
 *   theta [rad] angle, F [N m] friction torque, Fc > 0 [N m] Coulomb torque,
 *   sigma0 > 0 [N m/rad] stiffness at rest
 *   w = F/Fc, a = sigma0/Fc [1/rad], travel u = a |dtheta| in direction s = +-1
 *   w += (s - w) g(u),    g(u) = 1 - exp(-u)          exact for one tick     (Eqs. 7, 18, 27)
 * @endcode
 * The torque depends only on the path of theta, not on time. The presliding length is 1/a.
 *
 * @par Units: three usual mistakes
 * - theta_per_count is not the counts per turn: it is rad per count, 2 pi over the counts per turn.
 * - theta_per_count is not degrees per count.
 * - sigma0 is N m per rad: 1 N m/deg is 57.3 N m/rad.
 *
 * dahl_prepare() accepts such values. dahl_params_plausible() finds most of them.
 *
 * @par Limit: a reversal within one sample is invisible
 * Feed each edge, or sample faster than the shaft can reverse by one count. A lost sample causes no
 * error unless it hid a reversal. docs/model.md gives the error.
 *
 * @par Threads
 * Only dahl_prepare() writes a plan, so callers may share it. A state belongs to one caller: one
 * call at a time. The main program must not use a state that an interrupt steps.
 *
 * @par Change parameters while ticks run (examples/change_parameters)
 * -# Keep two plans.
 * -# The main program prepares the plan that no tick uses, then publishes its index in one word.
 * -# The tick that reads a new index calls dahl_change_plan(), then steps with the new plan.
 * -# The main program must not prepare again before the tick has switched.
 *
 * dahl_prepare() may rewrite a plan that a tick reads only if the parameters are equal to the
 * current ones: it writes each word once, with the same value.
 *
 * @par States
 * Every call first clamps the state to the range of its element and plan. With a prepared plan, any
 * bits are therefore a safe state, and no call returns a torque beyond the limits of its element.
 *
 * @par Plans
 * Only states may have any bits. A plan must have the bytes that its prepare function wrote, or all
 * zeros. With other bits, such as those of erased flash, the behaviour is undefined, and a torque
 * may have any size. No call checks a plan.
 * - A `const` plan of `dahl plan` is part of the program, and as good as its image.
 * - If parameters are stored in EEPROM or flash, store dahl_params_t with a CRC. At start-up, check
 *   the CRC, then call dahl_prepare().
 * - To check a plan that was stored, prepare another plan of zeros from the same parameters and
 *   compare the bytes with memcmp(). Equal parameters give equal bytes.
 *
 * @par Power cycle
 * Store dahl_torque() with a checksum and restore it with dahl_set_torque(). Do not store the bytes
 * of the state: a wrong bit may change the sign of the torque and stay in range.
 *
 * @par Failure
 * Only dahl_prepare() can fail; all other calls accept every input. A plan of all zeros (never
 * prepared, or rejected) moves nothing, and every torque in N m is 0.
 */
#ifndef DAHL_H
#define DAHL_H

#include <stdint.h>

/** @name Version */
/** @{ */
#define DAHL_VERSION_MAJOR 0 /**< major number */
#define DAHL_VERSION_MINOR 3 /**< minor number */
#define DAHL_VERSION_PATCH 0 /**< patch number */
#define DAHL_VERSION "0.3.0" /**< whole version */
/** @} */

/**
 * @name Error bounds
 * The tests read these values. One ulp of Fc is the distance from Fc to the next float away from
 * zero.
 */
/** @{ */
/** [ulp of Fc] Torque error if the state was moved by counts only. */
#define DAHL_ULP_COUNTS 0.52
/** [ulp of Fc] Torque error if dahl_step() has moved the state. */
#define DAHL_ULP_ANGLE 0.6
/** [1] Q30 error of F/Fc if the state was moved by counts only; 9.4e-10 if a count travels 4e-8 or
 * more. */
#define DAHL_ERROR_Q30 1.21e-9
/** [1] 2^-30, exact: F/Fc = DAHL_Q30 * (double)result keeps all bits of a Q30 result. */
#define DAHL_Q30 9.313225746154785e-10f
/** @} */

/** @name Parameter ranges of dahl_prepare() */
/** @{ */
#define DAHL_TORQUE_MIN 5.421010862427522e-20f /**< 2^-64: least Fc, sigma0 and theta_per_count */
#define DAHL_TORQUE_MAX 1.844674407370955e19f  /**< 2^64: the three must be below this value */
#define DAHL_TRAVEL_MIN 9.313225746154785e-10  /**< [1] 2^-30: least travel of one count,
                                                    sigma0/Fc * theta_per_count */
#define DAHL_TRAVEL_MAX 1048576.0              /**< [1] 2^20: the travel must be below this value */
/** @} */

/** Make compilers warn if a result is ignored. gcc also warns if it is cast to void. */
#if (defined(__cplusplus) && __cplusplus >= 201703L) \
    || (defined(__STDC_VERSION__) && __STDC_VERSION__ >= 202311L)
#define DAHL_NODISCARD [[nodiscard]]
#elif defined(__GNUC__)
#define DAHL_NODISCARD __attribute__((warn_unused_result))
#else
#define DAHL_NODISCARD
#endif

#ifdef __cplusplus
extern "C" {
#endif

/** Physical parameters of one Dahl element. */
typedef struct {
    float sigma0;          /**< [N m/rad] stiffness at rest, 2^-64 <= sigma0 < 2^64 */
    float Fc;              /**< [N m] Coulomb torque, 2^-64 <= Fc < 2^64 */
    float theta_per_count; /**< [rad/count] 2^-64 <= theta_per_count < 2^64; 0: no encoder,
                                dahl_step() only */
} dahl_params_t;

/** Result of a prepare function. */
typedef enum {
    DAHL_OK = 0,         /**< success */
    DAHL_ERR_PARAM = -1, /**< a parameter is NaN, infinite, negative, or zero but must not be */
    DAHL_ERR_RANGE = -2  /**< a parameter, or the exact travel of one count, is out of range */
} dahl_err_t;

/** A fraction in Q64. Two words, so that a step needs only 32 x 32 -> 64 bit products. 1 is stored
 * as 2^64 - 1 or 2^64 - 2. */
typedef struct {
    uint32_t hi; /**< upper 32 bits */
    uint32_t lo; /**< lower 32 bits */
} dahl_q64_t;

/** Values that dahl_prepare() derives from the parameters. Integers only: equal bits on every
 * machine; may be `const` in flash. */
typedef struct {
    uint32_t a_mantissa;  /**< sigma0/(Fc ln 2) = a_mantissa 2^a_exponent [1/rad]; top bit set */
    int32_t a_exponent;   /**< exponent of a_mantissa; 0x600000 less if sigma0/(Fc ln 2) is 2^62 or
                               more, or below 2^-121 */
    uint32_t Fc_mantissa; /**< Fc = Fc_mantissa 2^Fc_exponent [N m]; top bit set */
    int32_t Fc_exponent;  /**< exponent of Fc_mantissa */
    dahl_q64_t g[37];     /**< g(u) of 0, 1 .. 8 counts, then of 16, 32 .. 2^31 counts; all 0 if
                               there is no encoder */
} dahl_plan_t;

/** State of one friction element. All zeros is relaxed. The range is -2^62 - 2^31 <= w < 2^62 +
 * 2^31; no returned value shows the part beyond +-2^62. If w is out of range, the next call clamps
 * it to +-2^62. */
typedef struct {
    int64_t w; /**< [Q62] F/Fc; +-2^62 is +-Fc */
} dahl_state_t;

/**
 * Prepare a plan from parameters. Call it at start-up.
 *
 * @param[out] plan   plan to write; unchanged if the call fails
 * @param      params parameters; both pointers must be valid
 * @return #DAHL_OK, or why a parameter is rejected
 */
DAHL_NODISCARD dahl_err_t dahl_prepare(dahl_plan_t *plan, const dahl_params_t *params);

/** Result of dahl_params_plausible(): a unit that is probably wrong. */
typedef enum {
    DAHL_PLAUSIBLE = 0,         /**< no remark */
    DAHL_COUNTS_PER_TURN = 1,   /**< theta_per_count is above 1.6 rad, more than a quarter turn:
                                     counts per turn? */
    DAHL_DEGREES_PER_COUNT = 2, /**< 360/theta_per_count is the counts per turn of an encoder:
                                     degrees? */
    DAHL_SHORT_PRESLIDING = 3,  /**< one count is 16 presliding lengths Fc/sigma0 or more, so that
                                     each count ends at +-Fc: degrees per count? */
    DAHL_LONG_PRESLIDING = 4    /**< Fc/sigma0 is 128 rad (20 turns) or more: sigma0 in N m/deg, or
                                     sigma0 and Fc exchanged? */
} dahl_plausible_t;

/**
 * Check parameters for the usual mistakes with units. Call it if a person enters numbers. A remark
 * is no error: dahl_prepare() may accept the parameters.
 *
 * @param params parameters
 * @return the first remark of dahl_plausible_t; #DAHL_PLAUSIBLE also for #DAHL_ERR_PARAM
 * @note If a count is below 16 presliding lengths, correct parameters get no remark: neither on a
 *   linear axis in m, nor on a rotary axis of 4 to 2^26 counts per turn. By chance, 1 of 20000
 *   gears looks like degrees. So do 13 of these numbers of counts, all above 4 million.
 * @note A motor behind a gear may have values that look like some mistakes. These are not found:
 *   turns per count; degrees per count, with more than 46080 counts per turn that are no power of
 *   two; sigma0 in N m/deg, if Fc/sigma0 stays below 128 rad.
 * @note A program that does not call it does not link it. It is not for a tick.
 */
dahl_plausible_t dahl_params_plausible(const dahl_params_t *params);

/**
 * Move by encoder counts and return the torque (Eqs. 7, 18, 27).
 *
 * @param plan    prepared plan
 * @param state   state to move; 0 counts leave it bit-identical
 * @param dcounts [counts] signed move, any int32_t including INT32_MIN
 * @return F [N m], -Fc .. Fc, rounded once
 * @note Error: #DAHL_ULP_COUNTS ulp of Fc. After n ticks from rest with a total travel of U
 *   presliding lengths, it is at most 0.52 ulp of F plus Fc (2^-31 U + 2^-62 n).
 * @note Cost: the same for up to 8 counts, then more with each binary digit.
 */
float dahl_step_counts(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts);

/**
 * Move by encoder counts and return the torque as a fraction of Fc. Integers only: no float and no
 * compiler helper function.
 *
 * @param plan    prepared plan
 * @param state   state to move; 0 counts leave it bit-identical
 * @param dcounts [counts] signed move, any int32_t
 * @return F/Fc in Q30, -2^30 .. 2^30, a half rounded up
 * @note Error: #DAHL_ERROR_Q30, or 5.8e-9 if dahl_step() has moved the state.
 * @note Cost: nearly the same for up to 8 counts, then more with each binary digit.
 */
int32_t dahl_step_counts_q30(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts);

/**
 * Convert a torque ratio to whole units of your choice: uN m, mN m, counts of the drive current.
 * Torques can then be added as integers. No float, no division, no overflow.
 *
 * @param ratio_q30 result of a Q30 call, any int32_t
 * @param Fc_units  [your unit] torque of the ratio 1 (Fc, the sum of Fc, or the largest torque), 0
 *   .. 2^30; a larger value counts as 2^30
 * @return [your unit] ratio_q30 2^-30 Fc_units, rounded to nearest, a half rounded up
 * @note Error: half a unit plus the error of the ratio times Fc_units; 0.501 units for Fc = 0.5 N m
 *   in uN m. Rounding Fc itself to an integer adds at most half a unit.
 * @note If the unit is coarse, give Fc in 1/16 of it, add all torques, and return (sum + 8) >> 4. A
 *   shift alone rounds down, by half a unit on average.
 */
int32_t dahl_to_units(int32_t ratio_q30, uint32_t Fc_units);

/**
 * Move by an angle and return the torque (Eqs. 7, 18, 27).
 *
 * @param plan   prepared plan
 * @param state  state to move
 * @param dtheta [rad] signed move. If it is NaN or +-0, the state is unchanged. If it is +-Inf, the
 *   torque saturates at +-Fc.
 * @return F [N m], -Fc .. Fc
 * @note Error: #DAHL_ULP_ANGLE ulp of Fc for the floats fed. The bound holds forever if each travel
 *   u is at least 2^-30, otherwise for 2^31 ticks. A subnormal dtheta, or a travel u below 2^-64,
 *   counts as no motion.
 * @note g(u) is one of 16 cubics, without libm.
 */
float dahl_step(const dahl_plan_t *plan, dahl_state_t *state, float dtheta);

/**
 * Return the torque without motion.
 * @param plan  prepared plan
 * @param state state to read
 * @return F [N m], -Fc .. Fc
 */
float dahl_torque(const dahl_plan_t *plan, const dahl_state_t *state);

/**
 * Check that a state is in range, as every call of this header leaves it. A state out of range
 * shows memory corruption; a wrong bit within the range is not detected.
 *
 * @param state state to check
 * @return 1 if the state is in range, 0 if the next call would clamp it
 */
int dahl_state_ok(const dahl_state_t *state);

/**
 * Set the state to a torque.
 *
 * @param plan  prepared plan
 * @param state state to set
 * @param F     [N m] torque, clamped to +-Fc. If it is NaN, the state keeps its torque.
 * @note If |F| >= 2^-36 Fc, dahl_torque() then returns the same float.
 */
void dahl_set_torque(const dahl_plan_t *plan, dahl_state_t *state, float F);

/**
 * Switch a state from one plan to another. Call it between two ticks.
 *
 * The torque is kept, clamped to the new Fc. If the new sigma0 is smaller, the bristle keeps its
 * deflection instead: the torque is first scaled by sigma0_to/sigma0_from. The stored energy F^2/(2
 * sigma0) therefore never grows.
 *
 * @param from  plan used so far
 * @param to    plan to use from now on
 * @param state state to convert
 * @note Error of the new F, for any two plans: 2^-30 of F itself plus 2^-62 of the new Fc. The
 *   earlier error in N m stays, which is more ulp of a smaller Fc.
 */
void dahl_change_plan(const dahl_plan_t *from, const dahl_plan_t *to, dahl_state_t *state);

/**
 * Return the shortest signed move between two readings of a counter that wraps. dahl_encoder.h also
 * keeps the last reading.
 *
 * @param before  [counts] earlier reading, modulo `modulus`
 * @param now     [counts] later reading, modulo `modulus`
 * @param modulus number of values of the reading: 65536 for a 16-bit timer, 0 for a 32-bit timer,
 *   the counts per turn for an absolute encoder
 * @return [counts] move, -modulus/2 <= result < modulus/2; half a modulus counts as negative
 * @note Without a divider, a reading that is not below the modulus costs more.
 */
int32_t dahl_counts_between(uint32_t before, uint32_t now, uint32_t modulus);

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
/*
 * dahl: friction torque by Dahl's model, exact at every encoder tick.
 *
 * GUARANTEE
 *   A torque of a state that is fed by counts is within DAHL_ULP_COUNTS = 0.52 ulp of Fc of the exact solution of the model for
 *   these counts: any motion, any number of ticks, any sampling rate.
 *   Once dahl_step() has fed it an angle, the bound is DAHL_ULP_ANGLE = 0.6 ulp of Fc, for the float angles and the counts fed so
 *   far, from dahl_step_counts() and dahl_torque() too. A change of plan keeps the error that F had in N m, which is more ulp of
 *   a smaller Fc, and adds the one that dahl_change_plan() states.
 *   The same inputs give the same bits on every processor, compiler and set of flags: inside there are integers only.
 *   There is no heap, no global, no libm and no division by a variable in a step.
 *
 * THE MODEL, in five lines (Ciarla, Cahouet, Canudas de Wit, Quaine; equation numbers are theirs)
 *   dF/dtheta = sigma0 (1 - F/Fc sgn(dtheta))                                                       (Eq. 1)
 *   theta [rad] angle, F [N m] friction torque, Fc > 0 [N m] Coulomb torque, sigma0 > 0 [N m/rad] stiffness at rest.
 *   With w = F/Fc, a = sigma0/Fc [1/rad], travel u = a |dtheta| in direction s = +-1, the exact update of one tick is
 *       w += (s - w) g(u),    g(u) = 1 - exp(-u)                              (Eqs. 7, 18 and 27 in one recursion)
 *   Time does not appear: the torque depends on the path of theta only. For linear motion read m and N.
 *
 * USE
 *   static dahl_plan_t plan;                        // constant after dahl_prepare; may live in flash
 *   static dahl_state_t bearing;                    // all zeros: relaxed
 *   dahl_params_t p = {100.0f, 0.5f, 6.2831853f / 16384};   // sigma0 [N m/rad], Fc [N m], theta of a count [rad]
 *   if (dahl_prepare(&plan, &p) != DAHL_OK) { stop(); }
 *   each tick:  F = dahl_step_counts(&plan, &bearing, dahl_counts_between(before, now, 16384));
 *
 * SIGN   F has the sign of the motion. The bearing acts on the shaft with -F; feed-forward compensation adds +F.
 *
 * A REVERSAL INSIDE ONE SAMPLE CANNOT BE SEEN
 *   +3 and -2 counts between two samples is another path than +1, and leaves another torque (up to 2 Fc g(hidden travel)
 *   away). Feed each edge, or sample faster than the shaft can reverse by a count; a lost sample costs nothing
 *   unless it hid a reversal.
 *
 * THREADS  A plan is read-only for all calls but dahl_prepare() and can be shared. A state belongs to its caller: one call at a
 *   time, so never from main while an interrupt steps it.
 *   To change parameters while ticks run (examples/change_parameters): keep two plans. Main prepares the one that no tick uses
 *   and then publishes its index in one word; the tick that finds a new index calls dahl_change_plan(old, new, state) and
 *   steps by the new plan; main does not prepare again before the tick has taken it.
 *   dahl_prepare() on a plan that a tick reads is allowed with parameters equal to those that it has: each word is written
 *   once, with the value that it had. With others the tick could see words of both.
 * STATES   Every call first clamps the state to the range of its own element and plan. So any bits are a safe state, whether
 *   another element, another plan or bad memory left them: no call returns a torque beyond the limits of its element.
 *   Over a power cycle keep the torque, not the bytes of the state: store dahl_torque() with a checksum, and restore it by
 *   dahl_set_torque(). Bytes with one wrong bit are mostly still in range, and their torque may have the wrong sign.
 * FAILURE  dahl_prepare() is the only call that can fail; all others accept every input. A plan of all zeros (never prepared,
 *   or refused) moves nothing, and every torque in N m is 0.
 * BESIDE   dahl_float.h (the literal form, by a float exponential) and dahl_batch.h (long logs on a host) are libraries of
 *          their own, dahl::float and dahl::batch, that firmware does not compile unless it asks for them.
 */
#ifndef DAHL_H
#define DAHL_H

#include <stdint.h>

#define DAHL_VERSION_MAJOR 0
#define DAHL_VERSION_MINOR 2
#define DAHL_VERSION_PATCH 0
#define DAHL_VERSION "0.2.0"

/* Bounds that the tests read. One ulp of Fc is the distance from Fc to the next float away from zero. */
#define DAHL_ULP_COUNTS 0.52       /* torque error in ulp of Fc, of a state that is fed by counts alone */
#define DAHL_ULP_ANGLE 0.6         /* the same once dahl_step() has fed it an angle */
#define DAHL_ERROR_Q30 1.21e-9     /* dahl_step_counts_q30, by counts alone: of F/Fc; 9.4e-10 if a count travels 4e-8 or more */
#define DAHL_Q30 9.313225746154785e-10f /* 2^-30, exact: F/Fc = DAHL_Q30 * Q30 result; (double)result keeps all its bits */

/* What dahl_prepare accepts. */
#define DAHL_TORQUE_MIN 5.421010862427522e-20f  /* 2^-64 N m, for Fc; and N m/rad for sigma0, rad for theta_per_count */
#define DAHL_TORQUE_MAX 1.844674407370955e19f   /* 2^64, not included */
#define DAHL_TRAVEL_MIN 9.313225746154785e-10   /* 2^-30 <= sigma0/Fc * theta_per_count, travel of one count */
#define DAHL_TRAVEL_MAX 1048576.0               /* < 2^20 */

/* Compilers warn where the result of a call so marked is dropped; gcc also where it is cast to void. */
#if (defined(__cplusplus) && __cplusplus >= 201703L) || (defined(__STDC_VERSION__) && __STDC_VERSION__ >= 202311L)
#define DAHL_NODISCARD [[nodiscard]]
#elif defined(__GNUC__)
#define DAHL_NODISCARD __attribute__((warn_unused_result))
#else
#define DAHL_NODISCARD
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    float sigma0;          /* N m/rad, stiffness at rest, 2^-64 <= sigma0 < 2^64 */
    float Fc;              /* N m, Coulomb torque, 2^-64 <= Fc < 2^64 */
    float theta_per_count; /* rad/count, 2^-64 <= theta_per_count < 2^64; 0: no encoder counts, dahl_step only */
} dahl_params_t;

typedef enum {
    DAHL_OK = 0,
    DAHL_ERR_PARAM = -1, /* a parameter is NaN, infinite, negative, or zero where that has no meaning */
    DAHL_ERR_RANGE = -2  /* a parameter, or the exact travel of one count, is outside the range above */
} dahl_err_t;

/* A fraction in Q64, as two words so that a step needs 32 x 32 -> 64 bit products only. 1 is 2^64 - 1 or one less. */
typedef struct {
    uint32_t hi;
    uint32_t lo;
} dahl_q64_t;

/* Everything that parameters decide, prepared once. Integers only: bits equal everywhere, fit for `const` in flash. */
typedef struct {
    uint32_t a_mantissa;  /* sigma0/(Fc ln 2) = a_mantissa 2^a_exponent [1/rad]; top bit set */
    int32_t a_exponent;
    uint32_t Fc_mantissa; /* Fc = Fc_mantissa 2^Fc_exponent [N m]; top bit set */
    int32_t Fc_exponent;
    dahl_q64_t g[37];     /* g of 0, 1 .. 8 counts, then of 16, 32 .. 2^31 counts; all 0 without counts */
} dahl_plan_t;

/* w = F/Fc in Q62; +-2^62 is +-Fc, 0 is relaxed. The range is -2^62 - 2^31 <= w < 2^62 + 2^31, of which no returned value shows
 * what is beyond +-2^62. A w outside of it is clamped to +-2^62. */
typedef struct {
    int64_t w;
} dahl_state_t;

/* Prepare a plan. Fails iff a parameter is outside its range: then the code says why and *plan is untouched.
 * Any plan and params pointers must be valid. Cost: 3000 instructions on Cortex-M3; call it at start. */
DAHL_NODISCARD dahl_err_t dahl_prepare(dahl_plan_t *plan, const dahl_params_t *params);

/* Move by dcounts encoder counts, any int32_t (INT32_MIN too), and return the torque F in N m, rounded once.
 * 0 leaves the state bit-identical. Error: DAHL_ULP_COUNTS ulp of Fc. Tiny motions keep their relative accuracy: n ticks
 * from rest with a total travel of U presliding lengths err by at most 0.52 ulp of F and Fc (2^-31 U + 2^-62 n).
 * Cost on Cortex-M3, M4 (docs/microcontroller.md has all): 39 instructions up to 8 counts, and about 15 for each further
 * binary digit. */
float dahl_step_counts(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts);

/* The same move; returns F/Fc in Q30, -2^30 .. 2^30, a half rounded up. Integers only: no float, no helper function.
 * Error: DAHL_ERROR_Q30, or 5.8e-9 once dahl_step() has fed the state an angle.
 * Cost on Cortex-M3, M4, for -8 .. 8 counts: 15 to 19 instructions by the tick written for the core, 20 at a reversal from
 * +-Fc, and 23 by the C. */
int32_t dahl_step_counts_q30(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts);

/* A torque in whole units of your own, to be added to others in integers: uN m, mN m, counts of the drive's current. ratio_q30
 * is F/Fc as the Q30 calls of dahl.h and dahl_parts.h return it, any int32_t; Fc_units is what it is a ratio to (Fc, the sum
 * of Fc, the largest torque) in that unit, 0 .. 2^30; more is taken as 2^30. No float, no division; the same bits everywhere.
 * Returns ratio_q30 2^-30 Fc_units rounded to the nearest whole number, a half rounded up. Nothing overflows.
 * Error against Fc_units times the exact ratio: half a unit, and DAHL_ERROR_Q30 (or the bound of that other call) times
 * Fc_units: 0.501 units for an Fc of 0.5 N m in uN m. What Fc itself lost when it was made a whole number comes on top, at most half
 * a unit. If the unit is coarse, give Fc in 1/16 of it and round the sum of all torques to (sum + 8) >> 4. A shift alone rounds
 * down, half a unit on average.
 * Cost: 11 instructions on Cortex-M3, M4, 41 on M0. */
int32_t dahl_to_units(int32_t ratio_q30, uint32_t Fc_units);

/* Move by dtheta rad and return F in N m. Any float: NaN is ignored (state untouched), +-Inf saturates at +-Fc,
 * +-0 leaves the state bit-identical. Error: DAHL_ULP_ANGLE ulp of Fc for the floats fed, for ever if each |u| >= 2^-30,
 * else for 2^31 ticks; a subnormal dtheta and travel u below 2^-65 count as none.
 * Cost on Cortex-M3, M4: 100 instructions; g(u) is a polynomial and a table of 16 words, no libm. */
float dahl_step(const dahl_plan_t *plan, dahl_state_t *state, float dtheta);

/* The torque F in N m without motion, -Fc .. Fc. */
float dahl_torque(const dahl_plan_t *plan, const dahl_state_t *state);

/* Return 1 if the state is in range, as every call of this header leaves it, and 0 if the next one would clamp it: a sign of bad
 * memory. A wrong bit that leaves w in range does not show. Cost: 8 instructions on Cortex-M3. */
int dahl_state_ok(const dahl_state_t *state);

/* Set the state to torque F in N m, clamped to +-Fc; NaN is ignored. dahl_torque() then returns the same float
 * while |F| >= 2^-36 Fc. */
void dahl_set_torque(const dahl_plan_t *plan, dahl_state_t *state, float F);

/* Go on with other parameters, from plan `from` to plan `to`, between two ticks. The torque is kept while the bristle
 * can carry it: clamped to the new Fc, and scaled by sigma0_to/sigma0_from where that is below 1 (the bristle keeps its
 * deflection), so that the stored energy F^2/(2 sigma0) never grows. F after the change is what this says for F before it
 * within 2^-30 of F itself and 2^-62 of the new Fc, for any two plans. */
void dahl_change_plan(const dahl_plan_t *from, const dahl_plan_t *to, dahl_state_t *state);

/* Shortest signed way from one reading of a counter to the next, in counts: -n/2 <= result < n/2 for n = modulus (half
 * of it is taken as negative). The modulus is that of the reading, not of the turn: 65536 for a 16-bit timer, 0 for one of
 * 32 bits, the counts per turn for an absolute encoder. Readings are taken modulo n. dahl_encoder.h keeps the last reading. */
int32_t dahl_counts_between(uint32_t before, uint32_t now, uint32_t modulus);

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
/*
 * dahl_parts: models that real machines follow, beside one Dahl element and beside each other. Dahl's model has one curve for
 * every loop; measured bearings and gears bend otherwise (docs/model.md says which part lowers the error on which log).
 *
 * GUARANTEE, as dahl.h gives it
 *   A torque returned in N m by counts is within DAHL_ULP_PARTS = 0.55 ulp of Fc (of the sum of Fc where there are several) of the
 *   exact solution for the counts fed so far: any motion, any number of ticks, any sampling rate.
 *   The same inputs give the same bits on every processor, compiler and set of flags: inside there are integers only.
 *   There is no heap, no global, no libm and no division by a variable in a step.
 *   A state of all zeros is relaxed. A plan of all zeros moves nothing and gives 0 N m. A part that is not called is not linked.
 *
 * LAWS are those of the exact solution. A part keeps them within its rounding, and exactly if they say "bit for bit":
 *   A closed cycle gives back at most DAHL_ENERGY_ERROR of Fc times its way (of c Fc under a load c above 1), and 2^-59 Fc^2/sigma0
 *   more for each tick by angle.
 *   The opposite motion has the opposite torque, but a tie (a w whose low 32 bits are 2^31) rounds up both ways. A tick from a tie
 *   then differs by up to 2^-30 of Fc, and later torques by up to twice their error.
 *   A longer move by counts ends at most DAHL_MONOTONE_ERROR of Fc short of a shorter one from the same state, before it is
 *   rounded to a float.
 *
 * STATES   Every call first clamps the state to the range of its own element and plan. So any bits are a safe state, and no call
 *   returns a torque beyond the limits of its element. An element that goes on with the dahl_state_t of another keeps its w, not F.
 *   Over a power cycle dahl_torque() and dahl_set_torque() also keep the torque of an elasto-plastic element, by &plan.plastic,
 *   and of dahl_clamped_step(), up to Fc. No call sets the torque of the other elements: store their states with a checksum.
 *
 * UNITS, SIGN, THREADS and what happens to a reversal inside one sample: as in dahl.h.
 */
#ifndef DAHL_PARTS_H
#define DAHL_PARTS_H

#include <stddef.h>

#include "dahl.h"

#define DAHL_ULP_PARTS 0.55        /* torque error of every part, and of any mix, in ulp of (the sum of) Fc */
#define DAHL_ENERGY_ERROR 1e-9     /* energy that rounding may add, in Fc times the way */
#define DAHL_MONOTONE_ERROR 5.5e-9 /* by which rounding of w may shorten a longer move, in Fc */

#ifdef __cplusplus
extern "C" {
#endif

/*
 * SLIP ELEMENTS (Maxwell slip, Prandtl-Ishlinskii), up to DAHL_SLIP_MAX of them side by side
 *   Each is a spring of stiffness sigma0 that slips at the torque Fc: dF/dtheta = sigma0 while |F| < Fc, else F = +-Fc. That is
 *   Dahl's model with the exponent 0. The torque is the sum. Several of them have a memory of every reversal that is not yet
 *   wiped out by a larger one, as rolling bearings have (Rizos and Fassois 2004; Al-Bender's GMS without its velocity).
 * Laws, bit for bit: return-point memory (a closed inner loop leaves no trace), congruency (loops between the same two angles
 *   have one shape), Masing's rule (after a reversal the first curve, twice as large), odd symmetry, and travel that may be split
 *   into ticks in any way. The torque never falls with travel, and no closed cycle gives energy. The deflections are whole
 *   numbers, so nothing drifts over any number of ticks.
 */
#define DAHL_SLIP_MAX 8
#define DAHL_SLIP_ERROR_Q30 3.15e-9 /* dahl_slip_step_counts_q30: error of F / sum of Fc; 1.52e-9 with one element */

typedef struct {
    uint32_t elements;           /* 1 .. DAHL_SLIP_MAX; what follows in the arrays is not read */
    float theta_per_count;       /* rad/count, 2^-64 <= theta_per_count < 2^64 */
    float sigma0[DAHL_SLIP_MAX]; /* N m/rad, stiffness of each element, range as in dahl_params_t */
    float Fc[DAHL_SLIP_MAX];     /* N m, torque at which it slips, range as in dahl_params_t */
} dahl_slip_params_t;

/* An element, in whole units of its deflection. */
typedef struct {
    uint32_t limit;  /* units from rest to slipping, 2^30 .. 2^31 - 1 */
    uint32_t weight; /* torque of a unit, in 2^-62 of the sum of Fc */
} dahl_slip_element_t;

/* Everything that parameters decide, prepared once. Integers only: bits equal everywhere, fit for `const` in flash. */
typedef struct {
    uint64_t full;        /* torque of all elements at their limits: 2^62 or so; 0 in a plan of all zeros */
    uint32_t Fc_mantissa; /* sum of Fc = Fc_mantissa 2^Fc_exponent [N m], rounded up; top bit set */
    int32_t Fc_exponent;
    uint32_t elements;
    dahl_slip_element_t element[DAHL_SLIP_MAX];
    uint8_t shift[DAHL_SLIP_MAX]; /* 2^shift units are a count */
} dahl_slip_plan_t;

/* Deflection of each element in its units, -limit .. limit; 0 is relaxed. */
typedef struct {
    int32_t x[DAHL_SLIP_MAX];
} dahl_slip_state_t;

/* Prepare a plan. Fails iff a parameter is outside its range, or the travel sigma0/Fc theta_per_count of one count is, for any
 * element: then the code says why and *plan is untouched. theta_per_count = 0 is DAHL_ERR_PARAM: there is no step by angle.
 * Cost: 1800 instructions on Cortex-M3 for each element. */
DAHL_NODISCARD dahl_err_t dahl_slip_prepare(dahl_slip_plan_t *plan, const dahl_slip_params_t *params);

/* Move by dcounts encoder counts, any int32_t, and return the torque F in N m. 0 leaves the state bit-identical.
 * Error: DAHL_ULP_PARTS ulp of the sum of Fc, 0.522 with one element. All elements slipping give the sum of Fc, where a float
 * has it. Cost on Cortex-M3, M4, whatever the move: 51 instructions and 18 for each element. */
float dahl_slip_step_counts(const dahl_slip_plan_t *plan, dahl_slip_state_t *state, int32_t dcounts);

/* The same move; returns F / sum of Fc in Q30, -2^30 .. 2^30, a half rounded up. Integers only.
 * Cost on Cortex-M3, M4: 20 instructions and 18 for each element. */
int32_t dahl_slip_step_counts_q30(const dahl_slip_plan_t *plan, dahl_slip_state_t *state, int32_t dcounts);

/*
 * ANY MIX IN PARALLEL: elements that are turned by the same shaft, and whose torques add. A law holds for the sum where it holds
 *   for each part; a Dahl element has no return-point memory and no congruency, so a mix with one has neither.
 *   static const dahl_part_t parts[] = {DAHL_PART(&plan, &bearing), DAHL_SLIP_PART(&slip_plan, &seal)};
 *   each tick:  F = dahl_parallel_step_counts(parts, 2, dcounts);
 */
typedef struct {
    int64_t (*move)(const void *plan, void *state, int32_t dcounts); /* returns F/Fc in Q62 */
    const void *plan;
    void *state;
    uint32_t Fc; /* where the plan has the mantissa of Fc, and then its exponent: bytes from its start */
} dahl_part_t;

/* Initialisers of a dahl_part_t: a Dahl element as a part, slip elements as a part. The compiler refuses other plans and states. */
#define DAHL_PART(plan, state) {dahl_part_move, &(plan)->a_mantissa, &(state)->w, offsetof(dahl_plan_t, Fc_mantissa)}
#define DAHL_SLIP_PART(plan, state) {dahl_slip_part_move, &(plan)->full, &(state)->x[0], offsetof(dahl_slip_plan_t, Fc_mantissa)}

int64_t dahl_part_move(const void *plan, void *state, int32_t dcounts);
int64_t dahl_slip_part_move(const void *plan, void *state, int32_t dcounts);

/* Move all parts by dcounts and return the sum of their torques in N m, rounded once: the torques are added as the states
 * have them, with all their bits, however much Fc differs. No part at all gives 0 N m.
 * Error: DAHL_ULP_PARTS ulp of the sum of all Fc, for up to 10000 parts; 0.52 where all are Dahl elements.
 * Cost on Cortex-M3, M4: 50 instructions, and for each part 40 beside those of its own move. */
float dahl_parallel_step_counts(const dahl_part_t *parts, uint32_t count, int32_t dcounts);

/* Write for each part its share of the sum of Fc, in Q31 and negative: -2^31 .. 0, together -2^31. A plan of all zeros has none. To
 * be done again when a plan changes. Cost: 460 instructions on Cortex-M3 for each part. */
void dahl_parallel_shares(int32_t *shares, const dahl_part_t *parts, uint32_t count);

#define DAHL_PARALLEL_ERROR_Q30(parts) (DAHL_SLIP_ERROR_Q30 + 4.66e-10 * (parts)) /* dahl_parallel_step_counts_q30 */

/* The same move by the shares of the same parts; returns F / sum of Fc in Q30, -2^30 .. 2^30, a half rounded up. Integers only;
 * shares of all zeros give 0. All parts at Fc give +-2^30. dahl_to_units() makes units of torque of it.
 * Error of F / sum of Fc: DAHL_PARALLEL_ERROR_Q30(count); it is the largest of the parts' own in Q30, and 2^-31 for each part.
 * Cost on Cortex-M3, M4: 21 instructions, 22 for each Dahl element up to 8 counts, 11 and its own move for any other part. */
int32_t dahl_parallel_step_counts_q30(const dahl_part_t *parts, const int32_t *shares, uint32_t count, int32_t dcounts);

/*
 * WORK of a Dahl element, and THE WAY BACK from a torque to counts.
 */
#define DAHL_INVERSE_ERROR 1.5e-9 /* dahl_counts_to_torque: of Fc, by which rounding may reorder moves */

/* What a bearing has taken so far: all zeros at the start, or what dahl_work_step_counts() left. */
typedef struct {
    uint32_t counts[3]; /* travelled, lowest word first */
    uint32_t way[4];    /* of w = F/Fc in the direction of travel, in Q62, lowest word first */
} dahl_work_t;

/* dahl_step_counts() that also adds up the work. Cost on Cortex-M3: 53 instructions up to 8 counts. */
float dahl_work_step_counts(const dahl_plan_t *plan, dahl_state_t *state, dahl_work_t *work, int32_t dcounts);

/* dahl_step_counts_q30() that also adds up the work. Cost on Cortex-M3: 34 instructions up to 8 counts. */
int32_t dahl_work_step_counts_q30(const dahl_plan_t *plan, dahl_state_t *state, dahl_work_t *work, int32_t dcounts);

/* The work so far, the sum of F dtheta along the path, in J (N m rad), for the params of the plan: positive if the bearing
 * took energy. It is negative only by what the state had stored at the start, F^2/(2 sigma0), and by rounding, DAHL_ENERGY_ERROR of
 * Fc times the way. Infinite beyond the floats, 0 below the normal ones. Error after R reversals: half an ulp of the result, 2^-59
 * of Fc times the way, and (R + 1/2) times 1.5e-9 of Fc^2/sigma0, or 9.5e-10 if a count travels 4e-8 or more.
 * Source: Eq. 1, divided by its right-hand side and integrated. */
float dahl_work(const dahl_params_t *params, const dahl_work_t *work);

/* A move, in counts, after which dahl_step_counts() returns a torque that has reached F [N m]: F or beyond, seen from the torque
 * now. 0 if that is F. State and plan stay as they are. A move of one count less does not reach F.
 * It is the least move but for rounding, since a longer move may end a little short of a shorter one. A shorter move that reaches F
 * passes it by less than DAHL_INVERSE_ERROR of Fc, before it is rounded to a float. It is shorter by at most
 * 1 + DAHL_INVERSE_ERROR/(u p) counts. Here u is the travel of a count, and p is what F lacks of Fc in the direction of the move, as
 * a fraction of Fc, or 2^-25 if that is more: 0.05/u counts at F = Fc, 3e-9/u at Fc/2.
 * DAHL_ERR_PARAM: F is NaN or infinite. DAHL_ERR_RANGE: F is beyond Fc, or a move of 2^31 - 1 counts does not reach it. *dcounts is
 * then untouched.
 * Cost on Cortex-M3: about 1000 instructions, 1450 by counts of 1e-6 presliding lengths; where counts change the torque by less
 * than its rounding, up to 62 moves of dahl_step_counts(). */
DAHL_NODISCARD dahl_err_t dahl_counts_to_torque(const dahl_plan_t *plan, const dahl_state_t *state, float F, int32_t *dcounts);

/* The torque in N m at the tips of the loop that a shaft runs when it goes to and fro by the same stroke (counts from end to
 * end) for ever: Fc tanh(u/2), u the travel of the stroke. Error: 2^-30 of it, and one rounding.
 * Cost on Cortex-M3: 530 instructions for 1000 counts, 900 at most. */
float dahl_tip_torque(const dahl_plan_t *plan, uint32_t stroke);

/*
 * FRICTION THAT DEPENDS ON SPEED (viscous, Stribeck), beside what depends on the path.
 */
#define DAHL_VELOCITY_SEGMENTS 16

/* An odd table over the counts of one tick: torque[k] at (k + 1) 2^segment_bits counts forward, its negative backward, 0 at
 * rest, linear in between, the last value beyond. Viscous friction is a straight line, Stribeck's a table that falls; a value may
 * be negative. It stands beside the path: add it to a part's torque. Only a value that falls below 0 gives energy. */
typedef struct {
    uint32_t segment_bits;                /* 0 .. 24 */
    float torque[DAHL_VELOCITY_SEGMENTS]; /* N m; 0, or 2^-64 <= |torque| < 2^64 */
} dahl_velocity_params_t;

typedef struct {
    uint32_t segment_bits;
    uint32_t torque_mantissa; /* the largest |torque| = torque_mantissa 2^torque_exponent [N m] */
    int32_t torque_exponent;
    int32_t ratio_q30[DAHL_VELOCITY_SEGMENTS + 1]; /* torque over the largest, from 0 at rest to the end of each segment */
} dahl_velocity_plan_t;

/* As dahl_prepare(): a code, and *plan untouched, iff a parameter is outside its range. */
DAHL_NODISCARD dahl_err_t dahl_velocity_prepare(dahl_velocity_plan_t *plan, const dahl_velocity_params_t *params);

/* The torque in N m at a speed of dcounts a tick, any int32_t; 0 for a plan of all zeros. Error: 1.5 2^-30 of the largest torque
 * against the straight lines between the given values, and one rounding. Cost on Cortex-M3: 43 instructions. */
float dahl_velocity_torque(const dahl_velocity_plan_t *plan, int32_t dcounts);

/* The same in parts of the largest |torque|, in Q30. Cost on Cortex-M3: 23 instructions. */
int32_t dahl_velocity_torque_q30(const dahl_velocity_plan_t *plan, int32_t dcounts);

/*
 * ASYMMETRIC FRICTION: Fc of each direction its own, as under a preload, on a seal or in a gear with one flank worn
 *   dF/dtheta = sigma0 (1 - F/Fc_forward) forward, sigma0 (1 + F/Fc_backward) backward. With m = (Fc_forward - Fc_backward)/2 and
 *   h = (Fc_forward + Fc_backward)/2 that is F = m + h w, Dahl's model with another presliding length Fc/sigma0 each way.
 *   There is one sigma0 only: with two, a closed cycle could create energy. What F is measured from is no torque, so relaxed is
 *   F = 0 and not w = 0.
 * Laws: passive over every closed cycle; with Fc exchanged, the mirrored motion has the mirrored torque; a long way in either
 *   direction ends at that direction's Fc. Odd symmetry it has not, unless both are equal.
 */
#define DAHL_ASYMMETRIC_ERROR_Q30 1.41e-9 /* dahl_asymmetric_step_counts_q30: error of F / larger Fc */

typedef struct {
    float sigma0;          /* N m/rad, stiffness at F = 0, both ways; range as in dahl_params_t */
    float Fc_forward;      /* N m, F after a long way forward; range as in dahl_params_t */
    float Fc_backward;     /* N m, -F after a long way backward, the same range */
    float theta_per_count; /* rad/count, 2^-64 <= theta_per_count < 2^64 */
} dahl_asymmetric_params_t;

/* Everything that parameters decide, prepared once. Integers only: bits equal everywhere, fit for `const` in flash. */
typedef struct {
    uint64_t end_forward;  /* Fc_forward and Fc_backward in parts of the larger one, Q62 */
    uint64_t end_backward;
    uint32_t Fc_mantissa;  /* the larger one: Fc_mantissa 2^Fc_exponent [N m]; top bit set */
    int32_t Fc_exponent;
    dahl_q64_t forward[23]; /* g of 0, 1 .. 8 counts, then of 32, 128 .. 2^31 counts */
    dahl_q64_t backward[23];
} dahl_asymmetric_plan_t;

/* Prepare a plan. Fails iff a parameter is outside its range, or the travel sigma0/Fc theta_per_count of one count is, for either
 * Fc: then the code says why and *plan is untouched. theta_per_count = 0 is DAHL_ERR_PARAM: there is no step by angle.
 * Cost: 5000 instructions on Cortex-M3. */
DAHL_NODISCARD dahl_err_t dahl_asymmetric_prepare(dahl_asymmetric_plan_t *plan, const dahl_asymmetric_params_t *params);

/* Move by dcounts encoder counts, any int32_t, and return the torque F in N m, -Fc_backward .. Fc_forward; beyond the smaller of
 * the two by the error at most. 0 leaves the state bit-identical. w of the state is F in parts of the larger Fc.
 * Error: DAHL_ULP_PARTS ulp of the larger Fc. Cost on Cortex-M3, M4: 60 instructions up to 8 counts, by the C. */
float dahl_asymmetric_step_counts(const dahl_asymmetric_plan_t *plan, dahl_state_t *state, int32_t dcounts);

/* The same move; returns F / larger Fc in Q30, a half rounded up. Integers only. Cost on Cortex-M3, M4: 32 instructions. */
int32_t dahl_asymmetric_step_counts_q30(const dahl_asymmetric_plan_t *plan, dahl_state_t *state, int32_t dcounts);

/*
 * LOAD: a factor c on the friction, given with each tick: normal force, torque through a gear, preload, temperature
 *   Fc and sigma0 both follow c, so that the presliding length Fc/sigma0 stays, and with it the plan of one Dahl element. When the
 *   load falls the bristle keeps its deflection, and F falls with c. When it grows F is kept: no torque comes from loading alone.
 *   A tick takes its load first and then moves.
 * Laws: passive over every closed cycle of motion and load, since the stored energy F^2/(2 c sigma0) never grows by a load; at a
 *   load of 1 the torque has the bits of dahl_step_counts(); odd symmetry. To keep the deflection both ways would create energy,
 *   0.066 Fc^2/sigma0 in random cycles. sigma0 that stays while only Fc follows the load is another model, and not this one.
 */
#define DAHL_LOADED_ERROR_Q30 4.7e-9 /* dahl_loaded_step_counts_q30: error of F/Fc; 1.85e-9 while the load is 1 or less */

/* All zeros: relaxed, without load. */
typedef struct {
    dahl_state_t bristle; /* w = F / (load Fc) */
    uint32_t load_q30;    /* of the last tick */
} dahl_loaded_state_t;

/* Move by dcounts encoder counts, any int32_t, under the load c = load_q30 2^-30, and return the torque F in N m, -c Fc .. c Fc, to
 * the nearest float.
 * 2^30 is the load at which the plan holds; the range is 0 .. 2^31 - 1, and more is taken as 2^31 - 1, just below 2. Without load F
 * is 0 and the bristle relaxes as soon as there is a load again. If c Fc is below 2^-64 N m, a torque below 2^-32 c Fc is 0.
 * The same load and 0 counts leave the state bit-identical. Error: DAHL_ULP_PARTS ulp of c Fc.
 * Cost on Cortex-M3, M4: 90 instructions up to 8 counts, 266 if the load grew. */
float dahl_loaded_step_counts(const dahl_plan_t *plan, dahl_loaded_state_t *state, int32_t dcounts, uint32_t load_q30);

/* The same move; returns F/Fc in Q30, -2^31 < . < 2^31, a half rounded up. Integers only.
 * Cost on Cortex-M3, M4: 39 instructions, 221 if the load grew. */
int32_t dahl_loaded_step_counts_q30(const dahl_plan_t *plan, dahl_loaded_state_t *state, int32_t dcounts, uint32_t load_q30);

/*
 * LOAD THAT LEAVES THE STIFFNESS: the other passive rule. sigma0 stays and Fc alone follows the load, so that the presliding length
 *   c Fc/sigma0 changes with it, as where a bearing's own stiffness counts and not that of its contacts. A load that falls cuts F
 *   off at c Fc; one that grows leaves F. The state's w is F/Fc, and a tick is by angle, for no table by counts holds.
 * Laws: passive over every closed cycle of motion and load, since the stored energy F^2/(2 sigma0) never grows by a load; at a load
 *   of 1 the torque has the bits of dahl_step(); odd symmetry as there.
 */

/* Move by an angle of dtheta rad under the load c = load_q30 2^-30, as dahl_loaded_step_counts() takes it, and return the torque F
 * in N m, -c Fc .. c Fc, or beyond by 2^-31 Fc at most, to the nearest float. Without load F is 0 and stays 0 until there is motion
 * under a load. The range of dtheta, NaN and infinity are as with dahl_step(). Error: DAHL_ULP_ANGLE ulp of Fc, or of c Fc if that
 * is more. A part of a load is as exact as the whole, not as its own small torque. Under a load above 1 read the torque at rest by a
 * dtheta of 0: dahl_torque() clamps to +-Fc. A plan of all zeros leaves the state. Cost on Cortex-M3, M4: 165 instructions. */
float dahl_clamped_step(const dahl_plan_t *plan, dahl_state_t *state, float dtheta, uint32_t load_q30);

/*
 * ELASTO-PLASTIC FRICTION (Dupont, Hayward, Armstrong, Altpeter 2002; over space as in Hayward 2009): no creep below breakaway
 *   Up to F = b Fc in the direction of motion the bristle is a spring, dF/dtheta = sigma0. Beyond it slides, and the gap
 *   p = 1 - |F|/Fc falls as exp(-kappa u), u travel in presliding lengths, kappa = 1/(1 - b): the slope is continuous at b.
 *   With b near 0 the first loading is Dahl's; with b near 1 it is one slip element.
 * Laws: zero drift, bit for bit: while |F| stays below b Fc counts are added in whole numbers, and a way to and fro leaves no
 *   trace however often; odd symmetry; monotone in travel; passive over every closed cycle; sampling does not matter. Return-point
 *   memory it has not: like Dahl's, a closed inner loop that slides leaves a trace.
 */
#define DAHL_ELASTOPLASTIC_ERROR_Q30 3.1e-9 /* dahl_elastoplastic_step_counts_q30: error of F/Fc */

/* Everything that parameters decide, prepared once. Integers only: bits equal everywhere, fit for `const` in flash. */
typedef struct {
    dahl_plan_t plastic;    /* beyond b: Dahl's model with kappa sigma0. Its a is kappa/ln 2 for a unit of travel */
    int64_t breakaway;      /* b in Q62 */
    uint64_t travel[9];     /* of 0 .. direct_counts counts, in Q62 presliding lengths; of one that travels 2 or more, in Q57 */
    uint32_t gap_q31;       /* 1 - b */
    uint32_t direct_counts; /* moves up to this have an entry, 8 or less */
    uint32_t counts_max;    /* so many counts travel from 1 to 2; 0 if one travels more */
} dahl_elastoplastic_plan_t;

/* Prepare a plan from an element's parameters and b = breakaway, 0 < b < 1. Fails iff a parameter or the travel of one count is
 * outside its range: then the code says why and *plan is untouched. A b that is NaN, infinite, zero or negative is
 * DAHL_ERR_PARAM, one of 1 or more DAHL_ERR_RANGE; theta_per_count = 0 is DAHL_ERR_PARAM: there is no step by angle.
 * Cost: 4000 instructions on Cortex-M3. */
DAHL_NODISCARD dahl_err_t dahl_elastoplastic_prepare(dahl_elastoplastic_plan_t *plan, const dahl_params_t *params,
                                                     float breakaway);

/* Move by dcounts encoder counts, any int32_t, and return the torque F in N m, -Fc .. Fc. 0 leaves the state bit-identical.
 * Error: DAHL_ULP_PARTS ulp of Fc. Cost on Cortex-M3, M4: 75 instructions up to 8 counts, 144 if they cross b. */
float dahl_elastoplastic_step_counts(const dahl_elastoplastic_plan_t *plan, dahl_state_t *state, int32_t dcounts);

/* The same move; returns F/Fc in Q30, -2^30 .. 2^30, a half rounded up. Integers only.
 * Cost on Cortex-M3, M4: 38 instructions, 107 if they cross b. */
int32_t dahl_elastoplastic_step_counts_q30(const dahl_elastoplastic_plan_t *plan, dahl_state_t *state, int32_t dcounts);

#ifdef __cplusplus
}
#endif

#endif

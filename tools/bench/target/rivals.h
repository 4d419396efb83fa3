/* SPDX-License-Identifier: MIT */
/*
 * What a user would write without this library: w = F/Fc as a float, one update per tick of dcounts counts, torque out.
 * All have the same duty: travel from counts, direction from its sign, new torque. Their plan is a float or two.
 */
#ifndef RIVALS_H
#define RIVALS_H

#include <stdint.h>

#define RIVAL_TABLE 64 /* cells over travel 0 .. 8 */
#define RIVAL_TABLE_SCALE 8.0f
#define RIVAL_COUNTS 64

typedef struct {
    float Fc;
    float a_per_count;
    float table[RIVAL_TABLE + 1];
    float counts[RIVAL_COUNTS + 1]; /* g of whole counts */
    int32_t substeps;
} rival_plan_t;

/* w; and for the forms of the paper w at the last reversal, counts since, direction, and the logarithm of Eqs. 15, 26. */
typedef struct {
    float w;
    float w_reversal;
    uint32_t counts;
    float direction;
    float k;
} rival_state_t;

typedef float (*rival_step_t)(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);

void rival_prepare(rival_plan_t *plan, float sigma0, float Fc, float theta_per_count);
float rival_expm1f(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_expf(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_exp_double(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_euler(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_rk4(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_table(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);

/* The paper's closed form: anchored at the last reversal; and with one running exponent, Eqs. 7, 18, 27 as they stand. */
float rival_anchored(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_direct(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_expm1_double(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);

/* A float table of g for whole counts, and a float state. */
float rival_table_counts(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);

/* Solvers of Eq. 1 with plan->substeps equal parts of each tick. */
float rival_euler_parts(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_rk4_parts(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_backward_parts(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_trapezoid_parts(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);

/* What no way can do without: the state read, multiplied, written. */
float rival_floor(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);

/* Coulomb's model: F/Fc in Q30 is the direction of the last motion. */
int32_t rival_coulomb(int32_t *last, int32_t dcounts);

#endif

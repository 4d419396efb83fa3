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

typedef struct {
    float Fc;
    float a_per_count;
    float table[RIVAL_TABLE + 1];
} rival_plan_t;

typedef struct {
    float w;
} rival_state_t;

typedef float (*rival_step_t)(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);

void rival_prepare(rival_plan_t *plan, float sigma0, float Fc, float theta_per_count);
float rival_expm1f(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_expf(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_exp_double(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_euler(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_rk4(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);
float rival_table(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts);

#endif

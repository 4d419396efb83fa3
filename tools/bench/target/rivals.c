/* SPDX-License-Identifier: MIT */
/* See rivals.h. Written as well as a careful user would: constants prepared, no division, single precision kept. */
#include "rivals.h"

#include <math.h>

void rival_prepare(rival_plan_t *plan, float sigma0, float Fc, float theta_per_count)
{
    plan->Fc = Fc;
    plan->a_per_count = sigma0 / Fc * theta_per_count;
    for (int i = 0; i <= RIVAL_TABLE; i++) {
        plan->table[i] = -expm1f(-(float)i / RIVAL_TABLE_SCALE);
    }
}

static inline float direction(int32_t dcounts)
{
    return dcounts < 0 ? -1.0f : 1.0f;
}

static inline float travel(const rival_plan_t *plan, int32_t dcounts)
{
    return plan->a_per_count * fabsf((float)dcounts);
}

static inline float move(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts, float g)
{
    state->w += (direction(dcounts) - state->w) * g;
    return plan->Fc * state->w;
}

float rival_expm1f(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    return move(plan, state, dcounts, -expm1f(-travel(plan, dcounts)));
}

float rival_expf(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    return move(plan, state, dcounts, 1.0f - expf(-travel(plan, dcounts)));
}

float rival_exp_double(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    return move(plan, state, dcounts, (float)(1.0 - exp((double)-travel(plan, dcounts))));
}

float rival_euler(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    return move(plan, state, dcounts, travel(plan, dcounts));
}

/* dw/du = s - w by the classic four stages. */
float rival_rk4(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    float s = direction(dcounts), h = travel(plan, dcounts), w = state->w;
    float k1 = s - w;
    float k2 = s - (w + 0.5f * h * k1);
    float k3 = s - (w + 0.5f * h * k2);
    float k4 = s - (w + h * k3);
    state->w = w + h * (1.0f / 6.0f) * (k1 + 2.0f * (k2 + k3) + k4);
    return plan->Fc * state->w;
}

float rival_table(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    float x = travel(plan, dcounts) * RIVAL_TABLE_SCALE;
    if (x >= (float)RIVAL_TABLE) {
        return move(plan, state, dcounts, 1.0f);
    }
    int32_t cell = (int32_t)x;
    float below = plan->table[cell];
    return move(plan, state, dcounts, below + (x - (float)cell) * (plan->table[cell + 1] - below));
}

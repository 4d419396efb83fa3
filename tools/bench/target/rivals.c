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
    for (int i = 0; i <= RIVAL_COUNTS; i++) {
        plan->counts[i] = -expm1f(-plan->a_per_count * (float)i);
    }
    plan->substeps = 1;
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

/* Eq. 18, from the last reversal on: the travel since then is a whole number of counts. */
float rival_anchored(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    float s = direction(dcounts);
    uint32_t n = dcounts < 0 ? 0u - (uint32_t)dcounts : (uint32_t)dcounts;
    if (dcounts != 0 && s != state->direction) {
        state->w_reversal = state->w;
        state->counts = 0;
        state->direction = s;
    }
    state->counts = state->counts + n < n ? UINT32_MAX : state->counts + n;
    float u = plan->a_per_count * (float)state->counts;
    state->w = state->w_reversal - (state->direction - state->w_reversal) * expm1f(-u);
    return plan->Fc * state->w;
}

/* F = s Fc (1 - exp(k - s a theta)), k anew at each reversal (Eqs. 15, 26); theta since the start. */
float rival_direct(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    float s = direction(dcounts), a_theta = plan->a_per_count * (float)(int32_t)state->counts;
    if (dcounts != 0 && s != state->direction) {
        state->k = logf(1.0f - s * state->w) + s * a_theta;
        state->direction = s;
    }
    state->counts += (uint32_t)dcounts;
    s = state->direction;
    state->w = s * (1.0f - expf(state->k - s * plan->a_per_count * (float)(int32_t)state->counts));
    return plan->Fc * state->w;
}

float rival_expm1_double(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    return move(plan, state, dcounts, (float)-expm1((double)-travel(plan, dcounts)));
}

float rival_table_counts(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    uint32_t n = dcounts < 0 ? 0u - (uint32_t)dcounts : (uint32_t)dcounts;
    return move(plan, state, dcounts, plan->counts[n < RIVAL_COUNTS ? n : RIVAL_COUNTS]);
}

float rival_euler_parts(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    float s = direction(dcounts), h = travel(plan, dcounts) / (float)plan->substeps, w = state->w;
    for (int32_t i = 0; i < plan->substeps; i++) {
        w += (s - w) * h;
    }
    state->w = w;
    return plan->Fc * w;
}

float rival_rk4_parts(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    float s = direction(dcounts), h = travel(plan, dcounts) / (float)plan->substeps, w = state->w;
    for (int32_t i = 0; i < plan->substeps; i++) {
        float k1 = s - w, k2 = s - (w + 0.5f * h * k1), k3 = s - (w + 0.5f * h * k2), k4 = s - (w + h * k3);
        w += h * (1.0f / 6.0f) * (k1 + 2.0f * (k2 + k3) + k4);
    }
    state->w = w;
    return plan->Fc * w;
}

/* The division once a tick: w = (w + h s)/(1 + h), solved for the change. */
float rival_backward_parts(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    float s = direction(dcounts), h = travel(plan, dcounts) / (float)plan->substeps, w = state->w;
    float part = h / (1.0f + h);
    for (int32_t i = 0; i < plan->substeps; i++) {
        w += (s - w) * part;
    }
    state->w = w;
    return plan->Fc * w;
}

float rival_trapezoid_parts(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    float s = direction(dcounts), h = travel(plan, dcounts) / (float)plan->substeps, w = state->w;
    float part = h / (1.0f + 0.5f * h);
    for (int32_t i = 0; i < plan->substeps; i++) {
        w += (s - w) * part;
    }
    state->w = w;
    return plan->Fc * w;
}

float rival_floor(const rival_plan_t *plan, rival_state_t *state, int32_t dcounts)
{
    (void)plan;
    state->counts *= (uint32_t)dcounts;
    return 0.0f;
}

int32_t rival_coulomb(int32_t *last, int32_t dcounts)
{
    if (dcounts != 0) {
        *last = dcounts > 0 ? INT32_C(1) << 30 : -(INT32_C(1) << 30);
    }
    return *last;
}

/* SPDX-License-Identifier: MIT */
/**
 * Textbook form: travel since the last reversal, one float exponential, a branch at each sign change.
 *
 * The error of a direction does not accumulate: travel is summed in integers, which no compiler flag can reorder,
 * and the exponential always starts at the reversal. Each reversal rounds the torque. This error decays as
 * exp(-travel since); dahl_float.h has the bound.
 */
#include <math.h>

#include "dahl_float.h"

dahl_err_t dahl_float_prepare(dahl_float_plan_t *plan, const dahl_params_t *params)
{
    dahl_plan_t checked;
    dahl_err_t err = dahl_prepare(&checked, params); /* the same limits as the integer form */
    if (err == DAHL_OK) {
        plan->Fc = params->Fc;
        plan->a = params->sigma0 / params->Fc;
        plan->a_per_count = plan->a * params->theta_per_count;
    }
    return err;
}

/** Travel by angle is stored in Q57 presliding lengths. It saturates at 32 of them: exp(-32) is 1e-14. */
#define TRAVEL_ONE 0x1p57f
#define TRAVEL_END ((uint64_t)1 << 62)

static uint64_t travel_q57(float u)
{
    return u < 32.0f ? (uint64_t)(u * TRAVEL_ONE) : TRAVEL_END;
}

/** Clamp any bits to a valid state: |F/Fc| <= 1 at the reversal (NaN becomes 0), direction -1, 0 or 1, travel up to
 * TRAVEL_END. */
static void clamp_state(dahl_float_state_t *state)
{
    float w = state->w_reversal;
    state->w_reversal = fabsf(w) <= 1.0f ? w : w > 1.0f ? 1.0f : w < -1.0f ? -1.0f : 0.0f;
    state->direction = (state->direction > 0) - (state->direction < 0);
    state->travel = state->travel < TRAVEL_END ? state->travel : TRAVEL_END;
}

/** Return F/Fc after the travel since the last reversal (Eq. 18). */
static float w_now(const dahl_float_plan_t *plan, const dahl_float_state_t *state)
{
    float u = plan->a_per_count * (float)state->counts + (float)state->travel / TRAVEL_ONE;
    return state->w_reversal - ((float)state->direction - state->w_reversal) * expm1f(-u);
}

/** Use the present torque as the new start, at a sign change and before the counts exceed 32 bits. */
static void start_from_here(const dahl_float_plan_t *plan, dahl_float_state_t *state, int32_t direction)
{
    state->w_reversal = w_now(plan, state);
    state->travel = 0;
    state->counts = 0;
    state->direction = direction;
}

float dahl_float_step_counts(const dahl_float_plan_t *plan, dahl_float_state_t *state, int32_t dcounts)
{
    uint32_t n = dcounts < 0 ? 0u - (uint32_t)dcounts : (uint32_t)dcounts;
    int32_t direction = dcounts > 0 ? 1 : dcounts < 0 ? -1 : 0;
    clamp_state(state);
    if (direction != 0) {
        if (state->direction != direction || state->counts > UINT32_MAX - n) {
            start_from_here(plan, state, direction);
        }
        state->counts += n;
    }
    return plan->Fc * w_now(plan, state);
}

float dahl_float_step(const dahl_float_plan_t *plan, dahl_float_state_t *state, float dtheta)
{
    int32_t direction = dtheta > 0.0f ? 1 : dtheta < 0.0f ? -1 : 0; /* 0 for NaN */
    clamp_state(state);
    if (direction != 0) {
        if (state->direction != direction) {
            start_from_here(plan, state, direction);
        }
        uint64_t travel = state->travel + travel_q57(plan->a * fabsf(dtheta));
        state->travel = travel < TRAVEL_END ? travel : TRAVEL_END;
    }
    return plan->Fc * w_now(plan, state);
}

/* SPDX-License-Identifier: MIT */
/*
 * As friction.c, for the plans of the friction and of the compensator together: one store publishes both. Only the interrupt
 * reads and writes the bristle and the compensator, so only the interrupt converts them. Limit and slew hold in N m across it.
 */
#include "compensation.h"

#include <stdatomic.h>

typedef struct {
    dahl_plan_t friction;
    dahl_compensator_plan_t compensator;
    float Fc;
} plans_t;

static plans_t plans[2];
static dahl_state_t bristle;
static dahl_compensator_t compensator;
static atomic_uchar published; /* written by main only */
static atomic_uchar used;      /* written by the tick only */

bool compensation_set(const dahl_compensator_params_t *params, int *code)
{
    unsigned now = atomic_load_explicit(&published, memory_order_relaxed);
    plans_t *next = &plans[1 - now];
    *code = 0;
    if (atomic_load_explicit(&used, memory_order_acquire) != now) {
        return false;
    }
    *code = dahl_prepare(&next->friction, &params->friction);
    *code = *code != 0 ? *code : dahl_compensator_prepare(&next->compensator, params);
    if (*code != 0) {
        return false;
    }
    next->Fc = params->friction.Fc;
    atomic_store_explicit(&published, (unsigned char)(1 - now), memory_order_release);
    return true;
}

/* Return the plans of this tick. */
static const plans_t *take_plans(void)
{
    unsigned now = atomic_load_explicit(&used, memory_order_relaxed);
    unsigned next = atomic_load_explicit(&published, memory_order_acquire);
    if (next != now) {
        dahl_change_plan(&plans[now].friction, &plans[next].friction, &bristle);
        dahl_compensator_change(&plans[now].compensator, &plans[next].compensator, &compensator);
        atomic_store_explicit(&used, (unsigned char)next, memory_order_release);
    }
    return &plans[next];
}

float compensation_tick(int32_t dcounts, bool is_good)
{
    const plans_t *plan = take_plans();
    int32_t move = dahl_compensator_move(&plan->compensator, &compensator, dcounts, is_good);
    int32_t w = dahl_step_counts_q30(&plan->friction, &bristle, move);
    return (float)dahl_compensator_torque(&plan->compensator, &compensator, w) * DAHL_Q30 * plan->Fc;
}

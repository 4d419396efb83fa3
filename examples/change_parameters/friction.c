/* SPDX-License-Identifier: MIT */
/*
 * Two plans. The tick uses one. Main prepares the other and publishes it by one store. The next tick keeps the torque, changes
 * to the new plan and confirms it by one store. Then main may write the first plan. Release and acquire of C11 order the words
 * of the plan and these two stores, for the compiler and for the core.
 */
#include "friction.h"

#include <stdatomic.h>

static dahl_plan_t plans[2];
static dahl_state_t bearing;
/* Bytes, because a wider atomic access on AVR is a call that its libraries lack. */
static atomic_uchar published; /* written by main only */
static atomic_uchar used;      /* written by the tick only */

bool friction_set(const dahl_params_t *params, dahl_err_t *err)
{
    unsigned now = atomic_load_explicit(&published, memory_order_relaxed);
    unsigned next = 1 - now;
    *err = DAHL_OK;
    if (atomic_load_explicit(&used, memory_order_acquire) != now) {
        return false;
    }
    *err = dahl_prepare(&plans[next], params);
    if (*err != DAHL_OK) {
        return false;
    }
    atomic_store_explicit(&published, (unsigned char)next, memory_order_release);
    return true;
}

dahl_plan_t *friction_plan(void)
{
    return &plans[atomic_load_explicit(&published, memory_order_relaxed)];
}

float friction_tick(int32_t dcounts)
{
    unsigned now = atomic_load_explicit(&used, memory_order_relaxed);
    unsigned next = atomic_load_explicit(&published, memory_order_acquire);
    if (next != now) {
        dahl_change_plan(&plans[now], &plans[next], &bearing);
        atomic_store_explicit(&used, (unsigned char)next, memory_order_release);
    }
    return dahl_step_counts(&plans[next], &bearing, dcounts);
}

/* SPDX-License-Identifier: MIT */
/** The library in a page: one plan, one state, and the two functions of libc that the compiler may call. */
#include <stddef.h>

#include "dahl.h"

#define EXPORT(name) __attribute__((export_name(#name)))

static dahl_plan_t plan;
static dahl_state_t state;

/** Prepare the plan and relax the state. @return 0, or an error of dahl_prepare() and an unchanged plan */
EXPORT(prepare) int32_t prepare(float sigma0, float Fc, float theta_per_count)
{
    const dahl_params_t params = {sigma0, Fc, theta_per_count};
    state.w = 0;
    return dahl_prepare(&plan, &params);
}

/** @return F [N m] after a move by encoder counts */
EXPORT(step) float step(int32_t dcounts) { return dahl_step_counts(&plan, &state, dcounts); }

/** Start at a torque [N m]. */
EXPORT(set) void set(float F) { dahl_set_torque(&plan, &state, F); }

void *memset(void *to, int value, size_t n)
{
    unsigned char *byte = to;
    while (n--) { *byte++ = (unsigned char)value; }
    return to;
}

void *memcpy(void *restrict to, const void *restrict from, size_t n)
{
    unsigned char *byte = to;
    const unsigned char *source = from;
    while (n--) { *byte++ = *source++; }
    return to;
}

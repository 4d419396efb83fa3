/* SPDX-License-Identifier: MIT */
/*
 * The exact torque of slip elements, computed independently of the library. An element that last slipped at position n0 in
 * direction s has the deflection s r + (n - n0), with r = Fc/(sigma0 theta). Positions are whole counts, so no error
 * accumulates.
 */
#ifndef SLIP_REFERENCE_H
#define SLIP_REFERENCE_H

#include <math.h>

#include "dahl_parts.h"

typedef struct {
    long double r[DAHL_SLIP_MAX]; /* counts */
    int64_t slipped_at[DAHL_SLIP_MAX];
    int direction[DAHL_SLIP_MAX]; /* of the last slip; 0: never slipped */
    int64_t position;
    const dahl_slip_params_t *params;
} slip_reference_t;

static inline slip_reference_t slip_reference(const dahl_slip_params_t *params)
{
    slip_reference_t reference = {{0}, {0}, {0}, 0, params};
    for (uint32_t k = 0; k < params->elements; k++) {
        reference.r[k] = params->Fc[k] / ((long double)params->sigma0[k] * params->theta_per_count);
    }
    return reference;
}

static inline long double slip_reference_Fc(const dahl_slip_params_t *params)
{
    long double sum = 0;
    for (uint32_t k = 0; k < params->elements; k++) {
        sum += params->Fc[k];
    }
    return sum;
}

static inline long double slip_reference_move(slip_reference_t *reference, int64_t counts)
{
    long double F = 0;
    reference->position += counts;
    for (uint32_t k = 0; k < reference->params->elements; k++) {
        long double r = reference->r[k];
        long double x = reference->direction[k] * r + (long double)(reference->position - reference->slipped_at[k]);
        if (fabsl(x) >= r) {
            reference->direction[k] = x > 0 ? 1 : -1;
            reference->slipped_at[k] = reference->position;
            x = reference->direction[k] * r;
        }
        F += reference->params->Fc[k] * (x / r);
    }
    return F;
}

#endif

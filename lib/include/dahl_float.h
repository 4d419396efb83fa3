/* SPDX-License-Identifier: MIT */
/*
 * The literal form: float exponential and a branch where the motion changes sign (Eq. 1 solved anchored at the last
 * reversal, Eqs. 7, 18, 27). Needs libm (expm1f) and float hardware to be quick, gives other bits on other libms, and
 * adds an error at each reversal; it is here to read, to teach and to cross-check.
 * Error of F: DAHL_FLOAT_ERROR of Fc, once for now and once for each reversal that the bristle still remembers:
 * E (1 + sum over past reversals of exp(-travel u since)). Sweeps: 1 E or 2 E; 2 counts forward 1 back at u = 1e-6 a
 * count: up to 6e5 E. dahl.h has no such term.
 */
#ifndef DAHL_FLOAT_H
#define DAHL_FLOAT_H

#include "dahl.h"

#ifdef __cplusplus
extern "C" {
#endif

#define DAHL_FLOAT_ERROR 3e-7 /* of Fc; 5 units of 2^-24 */

typedef struct {
    float Fc;          /* N m */
    float a;           /* 1/rad */
    float a_per_count; /* travel of one count */
} dahl_float_plan_t;

/* All zeros: relaxed, no motion yet. */
typedef struct {
    float w_reversal;  /* F/Fc at the last reversal */
    float travel;      /* since then, by angle, rad */
    uint32_t counts;   /* since then, by counts */
    int32_t direction; /* +1, -1; 0 before the first motion */
} dahl_float_state_t;

/* As their namesakes of dahl.h: same units, same laws, same bad inputs, other bound. */
dahl_err_t dahl_float_prepare(dahl_float_plan_t *plan, const dahl_params_t *params);
float dahl_float_step_counts(const dahl_float_plan_t *plan, dahl_float_state_t *state, int32_t dcounts);
float dahl_float_step(const dahl_float_plan_t *plan, dahl_float_state_t *state, float dtheta);

#ifdef __cplusplus
}
#endif

#endif

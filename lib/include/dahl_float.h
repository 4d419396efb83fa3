/* SPDX-License-Identifier: MIT */
/*
 * The literal form: float exponential and a branch where the motion changes sign (Eq. 1 solved anchored at the last
 * reversal, Eqs. 7, 18, 27). Needs libm (expm1f) and float hardware to be quick, gives other bits on other libms, and
 * adds an error at each reversal; it is here to read, to teach and to cross-check.
 * ERROR OF F   With E = DAHL_FLOAT_ERROR of Fc: E for now, and E for each reversal that the bristle still remembers:
 *   E (1 + sum over past reversals of exp(-travel u since)).
 * Sweeps: 1 E or 2 E; 2 counts forward 1 back at u = 1e-6 a count: up to 6e5 E. dahl.h has no such term.
 * Without a reversal it stays E, however many steps the travel is made of, because travel is summed in integers:
 *   by counts exactly; where they would pass 2^32 in one direction, the torque is rounded once as at a reversal;
 *   by angle in units of 2^-57 presliding lengths: for ever if each step has u >= 2^-33, else for 2^32 steps in one
 *   direction; a step below one unit counts as none.
 * E holds, in units of 2^-24: four roundings of u (a, theta or travel, their product, the sum), each at most
 * 2 u exp(-u) <= 0.74; libm's expm1f at up to 1 ulp of g <= 1, times |s - w| <= 2; and two last roundings. Not all are
 * at their worst at once: 0.82 E is the worst that the tests find. Compiled with -ffast-math E still holds, but a NaN is
 * then no longer ignored.
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

/* All zeros: relaxed, no motion yet. As in dahl.h, every call first clamps it, so any bits are a safe state. */
typedef struct {
    float w_reversal;  /* F/Fc at the last reversal, -1 .. 1 */
    uint32_t counts;   /* travel since then, by counts */
    uint64_t travel;   /* travel since then, by angle, in presliding lengths, Q57, 2^62 at most */
    int32_t direction; /* +1, -1; 0 before the first motion */
} dahl_float_state_t;

/* As their namesakes of dahl.h: same units, same laws, same bad inputs, other bound. */
DAHL_NODISCARD dahl_err_t dahl_float_prepare(dahl_float_plan_t *plan, const dahl_params_t *params);
float dahl_float_step_counts(const dahl_float_plan_t *plan, dahl_float_state_t *state, int32_t dcounts);
float dahl_float_step(const dahl_float_plan_t *plan, dahl_float_state_t *state, float dtheta);

#ifdef __cplusplus
}
#endif

#endif

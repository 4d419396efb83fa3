/* SPDX-License-Identifier: MIT */
/*
 * The exact torque by another road than the library's: long double, anchored at the last reversal, the travel since then
 * added up exactly, one expm1l per value (the form of Eqs. 7, 18 and 27). Nothing accumulates but one rounding of
 * 2^-64 a reversal. Where long double is double (small cores) the bound of the tests still holds with 2^-53.
 */
#ifndef REFERENCE_H
#define REFERENCE_H

#include <math.h>
#include <stdint.h>

#include "dahl.h"

typedef struct {
    long double a;          /* travel u of one count, or of one radian */
    long double w_reversal; /* F/Fc at the last reversal */
    long double travel;     /* counts or radians since then; counts are exact up to 2^64 */
    int direction;
} reference_t;

static inline long double reference_w(const reference_t *r)
{
    return r->w_reversal - (r->direction - r->w_reversal) * expm1l(-r->a * r->travel);
}

static inline long double reference_move(reference_t *r, long double move)
{
    int direction = (move > 0) - (move < 0);
    if (direction != 0 && direction != r->direction) {
        r->w_reversal = reference_w(r);
        r->travel = 0;
        r->direction = direction;
    }
    r->travel += fabsl(move);
    return reference_w(r);
}

static inline reference_t reference_by_counts(const dahl_params_t *p)
{
    reference_t r = {(long double)p->sigma0 / p->Fc * p->theta_per_count, 0, 0, 0};
    return r;
}

static inline reference_t reference_by_angle(const dahl_params_t *p)
{
    reference_t r = {(long double)p->sigma0 / p->Fc, 0, 0, 0};
    return r;
}

/* One ulp of Fc as dahl.h defines it. */
static inline long double ulp_of(float Fc)
{
    return (long double)nextafterf(Fc, HUGE_VALF) - Fc;
}

#endif

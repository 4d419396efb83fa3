/* SPDX-License-Identifier: MIT */
/*
 * The exact torque, computed independently of the library (Eqs. 7, 18 and 27): one expm1l from the last reversal, over the
 * exact sum of travel since then. Each reversal adds one rounding of a long double. Small cores have a long double of 53 bits,
 * which still suffices for the bounds under test.
 */
#ifndef REFERENCE_H
#define REFERENCE_H

#include <math.h>
#include <stdint.h>

#include "dahl.h"

typedef struct {
    long double a;          /* travel u of one count, or of one radian */
    long double w_reversal; /* F/Fc at the last anchor */
    long double travel;     /* counts or radians since then; counts are exact up to 2^64 */
    int direction;          /* 0: no motion yet */
    long double end;        /* |F/Fc| after a long way: 1, but for models whose ends move */
} reference_t;

static inline long double reference_w(const reference_t *r)
{
    return r->w_reversal - (r->direction * r->end - r->w_reversal) * expm1l(-r->a * r->travel);
}

static inline void reference_anchor(reference_t *r, long double w)
{
    r->w_reversal = w;
    r->travel = 0;
}

static inline long double reference_move(reference_t *r, long double move)
{
    int direction = (move > 0) - (move < 0);
    if (direction != 0 && direction != r->direction) {
        reference_anchor(r, reference_w(r));
        r->direction = direction;
    }
    r->travel += fabsl(move);
    return reference_w(r);
}

static inline reference_t reference_by_counts(const dahl_params_t *p)
{
    reference_t r = {(long double)p->sigma0 / p->Fc * p->theta_per_count, 0, 0, 0, 1};
    return r;
}

static inline reference_t reference_by_angle(const dahl_params_t *p)
{
    reference_t r = {(long double)p->sigma0 / p->Fc, 0, 0, 0, 1};
    return r;
}

/* One ulp of Fc as dahl.h defines it. */
static inline long double ulp_of(float Fc)
{
    return (long double)nextafterf(Fc, HUGE_VALF) - Fc;
}

/* The same for a sum of Fc, which may be no float. */
static inline long double ulp_of_sum(long double Fc)
{
    int exponent;
    (void)frexpl(Fc, &exponent);
    return ldexpl(1, exponent - 24);
}

#endif

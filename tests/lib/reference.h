/* SPDX-License-Identifier: MIT */
/*
 * The exact torque, computed independently of the library (Eqs. 7 and 18): one expm1l for each move. Each move adds one
 * rounding of a long double, far below the bounds under test. Small cores have a long double of 53 bits, which still suffices.
 */
#ifndef REFERENCE_H
#define REFERENCE_H

#include <math.h>
#include <stdint.h>

#include "dahl.h"

typedef struct {
    long double a;   /* travel u of one count, or of one radian */
    long double w;   /* F/Fc */
    long double end; /* |F/Fc| after a long way: 1, but for models whose ends move */
} reference_t;

static inline long double reference_move(reference_t *r, long double move)
{
    const long double end = move < 0 ? -r->end : r->end;
    r->w -= (end - r->w) * expm1l(-r->a * fabsl(move));
    return r->w;
}

static inline reference_t reference_by_angle(const dahl_params_t *p)
{
    return (reference_t){(long double)p->sigma0 / p->Fc, 0, 1};
}

static inline reference_t reference_by_counts(const dahl_params_t *p)
{
    return (reference_t){(long double)p->sigma0 / p->Fc * p->theta_per_count, 0, 1};
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

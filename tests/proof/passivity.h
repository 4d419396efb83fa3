/* SPDX-License-Identifier: MIT */
/*
 * Energy of one step, in units of Fc^2/sigma0, w = F/Fc: work s w' u, done with the torque w' after the step, less what the
 * bristle stores more than before, (w'^2 - w^2)/2. With the move m = s (w' - w) that is
 *     loss = s w' (u - m) + m^2/2,
 * where nothing cancels. A closed cycle adds up its losses and gives back what it stored: so no cycle from rest yields work,
 * and none from elsewhere more than was stored, but for the rounding of its steps.
 *
 * In words of n bits (the library: 32; w in Q(2n-2), z in Q(n-2), g in Q(2n)) a step takes w as q = w - d, |d| <= D = 2^-(n-1),
 * and moves by m = z g - t with z = 1 - s q and 0 <= t < T = 2^-(2n-2). With u = -ln(1 - g), and W the state before the cut,
 *     loss = g ((1 - z)^2 + s d (1 - z)) + g^2 z (1 - z/2) + (u - g) s W - t (u - s W) - t^2/2
 * The first term is at least -g D^2/4, the second is never negative, nor the third while the torque opposes the motion; where
 * it helps, -(u - g) s W < (u - g) (z - 1), which the first two outweigh. The cut makes T at most. In all
 *     loss >= -(T + g D^2/4)
 *
 * In the library u is what the motion says and g errs by r: that adds as d does, and makes g (D + r)^2/4 of the last term.
 * By counts, where u >= 2^-30 and r = 2^-32, the first two terms are more than all that is negative: at least g^2/2 >= 2^-61
 * (1 - g) where w is next to nothing, g w^2 elsewhere. So no tick by counts makes energy. By angle, r = 2^-29 and u may be
 * next to nothing: 2^-62 + 1.6 2^-60 < 2^-59.
 */
#ifndef PASSIVITY_H
#define PASSIVITY_H

#include <math.h>

/* Most energy that a tick makes, of Fc^2/sigma0. */
#define PASSIVITY_COUNTS 0.0
#define PASSIVITY_ANGLE 0x1p-59

static inline long double passivity_loss(long double s_w_after, long double m, long double u)
{
    return s_w_after * (u - m) + m * m / 2;
}

/* With the torque before the step, for the test that this makes energy. */
static inline long double passivity_loss_before(long double s_w_after, long double m, long double u)
{
    return passivity_loss(s_w_after, m, u) - m * u;
}

#ifndef PASSIVITY_LOSS
#define PASSIVITY_LOSS passivity_loss
#endif

#endif

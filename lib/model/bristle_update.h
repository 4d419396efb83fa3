/* SPDX-License-Identifier: MIT */
/*
 * One update of the bristle, private. In the direction of travel let gap = 1 - s w, in [0, 2]: travel shrinks it by
 * exp(-u), that is by g(u) of itself, and a reversal reflects it (gap -> 2 - gap). So the exponential with its sign-change
 * branch is one product:
 *     q = w in Q30, rounded        z = 1 - s q        w += s z g      z g is a 32 x 64 bit product, kept in Q62
 * q is what a Q30 tick returns, so z is the gap that its user sees.
 * Range: z passes the gap by half a unit of Q30 at most and g < 1, so -2^62 - 2^31 <= w < 2^62 + 2^31: at both ends q is
 * +-2^30, the next z is 0, and it stays: saturation shows as +-2^30 and as +-Fc, exactly. w is unsigned here: a state that no
 * call can leave gives a wrong torque, but never undefined behaviour.
 * Odd symmetry: backward mirrors forward bit for bit, except where w is a tie (its low word 2^31), which rounds up on both
 * sides. A rounding that mirrors there too costs an instruction a tick.
 * Error: z errs by 2^-31 of Fc at most. A step adds that times g and shrinks what was there by 1 - g, so over any motion
 * the sum stays below that, plus 2^-62/g for the truncated low product, plus what g errs: docs/accuracy.md. By
 * angle, where g may be tiny, it comes as g + 2^-63 (kernel.h): at w = 0, where z = 2^30, that makes the truncation a
 * rounding to nearest.
 */
#ifndef DAHL_BRISTLE_UPDATE_H
#define DAHL_BRISTLE_UPDATE_H

#include "../arith/fixed.h"
#include "dahl.h"

#define DAHL_DIRECT_COUNTS_MAX 8 /* moves of up to this many counts have an entry of their own */

/* w in Q30, a half rounded up. */
static inline uint32_t dahl_q30(uint64_t w)
{
    return (uint32_t)(w >> 32) + ((uint32_t)w >> 31);
}

static inline uint64_t dahl_forward(uint64_t w, dahl_q64_t g)
{
    return w + dahl_mul_fraction(DAHL_ONE_Q30 - dahl_q30(w), g.hi, g.lo);
}

static inline uint64_t dahl_backward(uint64_t w, dahl_q64_t g)
{
    return w - dahl_mul_fraction(DAHL_ONE_Q30 + dahl_q30(w), g.hi, g.lo);
}

/* A move of more counts (step_large.c), out of line to keep the tick short. Returns F/Fc in Q30. */
int32_t dahl_step_large(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts);

/* A move by an angle, given by its bits, that is not a normal float, or by a plan of all zeros (step_nonfinite.c). Returns F in
 * N m. */
float dahl_step_nonfinite(const dahl_plan_t *plan, dahl_state_t *state, uint32_t bits);

#endif

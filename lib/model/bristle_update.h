/* SPDX-License-Identifier: MIT */
/*
 * One update of the bristle, private. In the direction of travel let gap = 1 - s w, in [0, 2]: travel shrinks it by
 * exp(-u), that is by g(u) of itself, and a reversal reflects it (gap -> 2 - gap). So the exponential with its sign-change
 * branch is one product:
 *     q = w in Q30, rounded        z = 1 - s q        w += s z g      z g is a 32 x 64 bit product, kept in Q62
 * q is what a Q30 tick returns, so z is the gap that its user sees.
 * Range: z passes the gap by half a unit of Q30 at most and g < 1, so -2^62 - 2^31 <= w < 2^62 + 2^31: at both ends q is
 * +-2^30, the next z is 0, and it stays: saturation shows as +-2^30 and as +-Fc, exactly. So w is in range if and only if
 * 0 <= z <= 2^31. A call that meets another w, of another element or of bad memory, first clamps it to +-2^62. w is unsigned
 * here, so that no bits have undefined behaviour.
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

/* z of a move in each direction. */
static inline uint32_t dahl_gap_forward(uint64_t w)
{
    return DAHL_ONE_Q30 - dahl_q30(w);
}

static inline uint32_t dahl_gap_backward(uint64_t w)
{
    return DAHL_ONE_Q30 + dahl_q30(w);
}

/* Whether z, of either direction, is that of a w in range. */
static inline int dahl_is_gap(uint32_t z)
{
    return DAHL_LIKELY(z <= DAHL_TOP_BIT) != 0;
}

static inline uint64_t dahl_forward(uint64_t w, dahl_q64_t g)
{
    return w + dahl_mul_fraction(dahl_gap_forward(w), g.hi, g.lo);
}

static inline uint64_t dahl_backward(uint64_t w, dahl_q64_t g)
{
    return w - dahl_mul_fraction(dahl_gap_backward(w), g.hi, g.lo);
}

/* w, or the end of its side, +-2^62, if it is out of range. */
static inline uint64_t dahl_clamp(uint64_t w)
{
    return dahl_is_gap(dahl_gap_backward(w)) ? w : (w >> 63 << 63 | DAHL_ONE_Q62);
}

/* A move of more counts, or from a w out of range (step_large.c), out of line to keep the tick short. Returns F/Fc in Q30. */
int32_t dahl_step_large(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts);

/* A move by an angle, given by its bits, that is not a normal float, or by a plan of all zeros, or from a w out of range
 * (step_rare.c). Returns F in N m. */
float dahl_step_rare(const dahl_plan_t *plan, dahl_state_t *state, uint32_t bits);

#endif

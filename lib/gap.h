/* SPDX-License-Identifier: MIT */
/*
 * One update of the bristle, private. In the direction of travel let gap = 1 - s w, in [0, 2]: travel shrinks it by
 * exp(-u), that is by g(u) of itself, and a reversal reflects it (gap -> 2 - gap). So the exponential with its sign-change
 * branch is one product:
 *     q = w in Q30, rounded        z = 1 - s q        w += s z g      z g is a 32 x 64 bit product, kept in Q62
 * q is what a Q30 tick returns, so z is the gap that its user sees.
 * Range: z passes the gap by half a unit of Q30 at most and g < 1, so |w| <= 2^62 + 2^31: there q is +-2^30, the next z
 * is 0, and it stays: saturation shows as +-2^30 and as +-Fc, exactly.
 * Odd symmetry: backward mirrors forward bit for bit, except where w is a tie (its low word 2^31), which rounds up on both
 * sides. A rounding that mirrors there too costs an instruction a tick.
 * Error: z errs by 2^-31 of Fc at most. A step adds that times g and shrinks what was there by 1 - g, so over any motion
 * the sum stays below that, plus 2^-62/g for the truncated low product. The plan holds g + 2^-63 (prepare.c): at
 * w = 0, where z = 2^30, that makes the truncation a rounding to nearest, which is what keeps tiny torques accurate.
 */
#ifndef DAHL_GAP_H
#define DAHL_GAP_H

#include "fixed.h"

#define DAHL_DENSE 8 /* moves of up to this many counts have an entry of their own */
#define DAHL_ONE_Q30 (1u << 30)

/* w in Q30, a half rounded up. */
static inline uint32_t dahl_q30(uint64_t w)
{
    return (uint32_t)((w + DAHL_TOP_BIT) >> 32);
}

/* z times g in Q62. */
static inline uint64_t dahl_part(uint32_t z, dahl_q64_t g)
{
    return dahl_mul(z, g.hi) + dahl_mulhi(z, g.lo);
}

/* The low product first, by words: it leaves the sum where a multiply-accumulate takes it. */
static inline uint64_t dahl_forward(uint64_t w, dahl_q64_t g)
{
    uint32_t z = DAHL_ONE_Q30 - dahl_q30(w);
    uint32_t low = (uint32_t)w + dahl_mulhi(z, g.lo);
    uint32_t high = (uint32_t)(w >> 32) + (low < (uint32_t)w);
    return ((uint64_t)high << 32 | low) + dahl_mul(z, g.hi);
}

/* Signed, so that the compiler keeps the product in one piece; z <= 2^31 and g < 1 keep it below 2^63. */
static inline uint64_t dahl_backward(uint64_t w, dahl_q64_t g)
{
    uint32_t z = DAHL_ONE_Q30 + dahl_q30(w);
    return (uint64_t)((int64_t)w - (int64_t)dahl_part(z, g));
}

/* What dahl_step leaves to others, by the bits of dtheta (far_angle.c). */
float dahl_step_far(const dahl_plan_t *plan, dahl_state_t *state, uint32_t bits);

/* A move beyond the dense entries, out of line to keep the tick short. Moves the state and returns its w. */
uint64_t dahl_move_digits(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts);
float dahl_step_digits(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts); /* and its torque */

#endif

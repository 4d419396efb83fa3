/* SPDX-License-Identifier: MIT */
/**
 * One exact update of the bristle.
 *
 * @par Idea
 * Let gap = 1 - s w in [0, 2] be the distance to saturation in the direction of travel s. Travel u removes the
 * fraction g(u) of it. A reversal reflects it: gap -> 2 - gap. The exponential and the branch on the sign change
 * become one product (Eqs. 7, 18, 27):
 * @verbatim
 *     q = w rounded to Q30        z = 1 - s q        w += s z g        z g: a 32 x 64 bit product in Q62
 * @endverbatim
 * A Q30 tick returns q, so the step uses the gap that the caller sees.
 *
 * @par Range
 * z exceeds the gap by at most half a unit of Q30, and g < 1. Hence -2^62 - 2^31 <= w < 2^62 + 2^31. At both ends q
 * is +-2^30, the next z is 0, and w stays there: saturation reads exactly +-2^30 and +-Fc. A w is thus in range if
 * and only if 0 <= z <= 2^31. Every call first clamps any other w to +-2^62. w is unsigned here, so no bits cause
 * undefined behaviour.
 *
 * @par Symmetry
 * A backward move mirrors a forward move bit for bit, except at a tie (the low word of w is 2^31), which rounds up
 * in both directions. Mirroring the tie would cost one instruction per tick.
 *
 * @par Error
 * z is wrong by at most 2^-31 of Fc. A step adds this error times g, and shrinks the earlier error by 1 - g, so the
 * sum has a bound for any motion (docs/accuracy.md).
 */
#ifndef DAHL_BRISTLE_UPDATE_H
#define DAHL_BRISTLE_UPDATE_H

#include "../arith/fixed.h"
#include "dahl.h"

#define DAHL_DIRECT_COUNTS_MAX 8 /* [counts] the plan has one entry of g for each move up to this size */

/** Round w from Q62 to Q30, a half up. Return F/Fc in Q30. */
static inline uint32_t dahl_q30(uint64_t w)
{
    return (uint32_t)(w >> 32) + ((uint32_t)w >> 31);
}

/** Return z, the gap in the direction of the move, in Q30. */
static inline uint32_t dahl_gap_forward(uint64_t w)
{
    return DAHL_ONE_Q30 - dahl_q30(w);
}

static inline uint32_t dahl_gap_backward(uint64_t w)
{
    return DAHL_ONE_Q30 + dahl_q30(w);
}

/** Return true if z, for either direction, belongs to a w in range. */
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

/** Return w, or +-2^62 on its side if it is out of range. */
static inline uint64_t dahl_clamp(uint64_t w)
{
    return dahl_is_gap(dahl_gap_backward(w)) ? w : (w >> 63 << 63 | DAHL_ONE_Q62);
}

/** Move by more counts, or from a w out of range (step_large.c); out of line to keep the usual tick short. Return
 * F/Fc in Q30. */
int32_t dahl_step_large(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts);

/** Rare cases of dahl_step() (step_rare.c). `bits` are those of the angle. Return F [N m]. */
float dahl_step_rare(const dahl_plan_t *plan, dahl_state_t *state, uint32_t bits);

#endif

/* SPDX-License-Identifier: MIT */
/*
 * What the bitwise batches share, private: a tick by counts and its torque, for processors with fast doubles and 64-bit
 * words. The bits are those of gap.h and torque.h, whose functions do the work.
 */
#ifndef DAHL_BATCH_H
#define DAHL_BATCH_H

#include <stddef.h>
#include "gap.h"
#include "torque.h"

/* The gap z in the direction of travel, with a mask (all ones: backward) in place of the branch. */
static inline uint32_t dahl_batch_gap(uint64_t w, uint32_t backward)
{
    return DAHL_ONE_Q30 - ((dahl_q30(w) ^ backward) - backward);
}

/* As dahl_forward or dahl_backward. */
static inline uint64_t dahl_batch_near(uint64_t w, dahl_q64_t g, uint32_t backward)
{
    uint64_t mask = (uint64_t)0 - (backward & 1u);
    uint32_t z = dahl_batch_gap(w, backward);
    return w + (((dahl_mul(z, g.hi) + dahl_mulhi(z, g.lo)) ^ mask) - mask);
}

static inline uint32_t dahl_batch_size(int32_t dcounts, uint32_t backward)
{
    return ((uint32_t)dcounts ^ backward) - backward;
}

/* As dahl_move_digits; where no gap is left, no further digit changes a bit. */
static inline uint64_t dahl_batch_far(const dahl_plan_t *plan, uint64_t w, uint32_t size, uint32_t backward)
{
    uint32_t rest = size / DAHL_DENSE;
    w = dahl_batch_near(w, plan->g[size % DAHL_DENSE], backward);
    while (rest != 0 && dahl_batch_gap(w, backward) != 0) {
        uint32_t digit = 31u - dahl_leading_zeros(rest & (0u - rest));
        w = dahl_batch_near(w, plan->g[DAHL_DENSE + digit], backward);
        rest &= rest - 1u;
    }
    return w;
}

static inline void dahl_batch_move(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    uint32_t backward = (uint32_t)0 - (uint32_t)(dcounts < 0);
    uint32_t size = dahl_batch_size(dcounts, backward);
    uint64_t w = (uint64_t)state->w;
    if (DAHL_LIKELY(size <= DAHL_DENSE)) {
        w = dahl_batch_near(w, plan->g[size], backward);
    } else {
        w = dahl_batch_far(plan, w, size, backward);
    }
    state->w = (int64_t)w;
}

typedef union {
    double value;
    uint64_t bits;
} dahl_double_t;

/* Fc 2^-62, exactly: the torque of w = 1 in Q62. */
static inline double dahl_batch_unit(const dahl_plan_t *plan)
{
    dahl_double_t power;
    power.bits = (uint64_t)(1023 - 62 + dahl_exponent_of_Fc(plan)) << 52;
    return (double)plan->Fc_mantissa * power.value;
}

/* As dahl_torque_of, by doubles: 32 bits of w from its first one on, times the same mantissa. The product errs by less than
 * 4 units in its last place, so rounding it to a float gives the right bits unless it lies that close to the middle between
 * two floats; there the integers decide. Where w has more than 53 bits, those that the 32 leave out anyway go first: so the
 * conversion to double never rounds. */
static inline dahl_double_t dahl_batch_product(int64_t w, double unit)
{
    dahl_double_t torque;
    uint64_t sign = (uint64_t)w >> 63, size = ((uint64_t)w ^ (0u - sign)) + sign;
    size &= ~(size >> 53 != 0 ? (uint64_t)1023 : 0u);
    torque.value = (double)(int64_t)size;
    torque.bits &= ~(uint64_t)0x1fffff;
    torque.value *= unit;
    torque.bits |= sign << 63;
    return torque;
}

static inline int dahl_batch_is_close(dahl_double_t torque)
{
    return ((torque.bits + 4u) & 0x1fffffffu) - 0x10000000u <= 8u;
}

static inline float dahl_batch_torque(const dahl_plan_t *plan, int64_t w, double unit)
{
    dahl_double_t torque = dahl_batch_product(w, unit);
    if (DAHL_LIKELY(!dahl_batch_is_close(torque))) {
        return (float)torque.value;
    }
    return dahl_torque_of(plan, (uint64_t)w);
}

#endif

/* SPDX-License-Identifier: MIT */
/*
 * What the bitwise batches share, private: a tick by counts and its torque, for processors with fast doubles and 64-bit
 * words. The bits are those of bristle_update.h and torque.h, whose functions do the work.
 */
#ifndef DAHL_BATCH_EXACT_H
#define DAHL_BATCH_EXACT_H

#include <stddef.h>
#include "dahl_batch.h"
#include "../model/bristle_update.h"
#include "../model/torque.h"

/* Backward is forward on the complement (step_large.c), so the direction is a mask, all ones or none, and no branch. */
static inline uint64_t dahl_batch_backward(int32_t dcounts)
{
    return 0u - (uint64_t)((uint32_t)dcounts >> 31);
}

static inline uint32_t dahl_batch_size(int32_t dcounts)
{
    return dcounts < 0 ? 0u - (uint32_t)dcounts : (uint32_t)dcounts;
}

/* 2^32 times the gap z, and less than a unit of z: as 1 - dahl_q30(w), in one subtraction. */
static inline uint64_t dahl_batch_gap(uint64_t w)
{
    return DAHL_ONE_Q62 + 0x7fffffffu - w;
}

#if defined(__SIZEOF_INT128__)
__extension__ typedef unsigned __int128 dahl_product_t;

/* As dahl_forward, in the least time from w to w. */
static inline uint64_t dahl_batch_forward(uint64_t w, dahl_q64_t g)
{
    uint64_t z = dahl_batch_gap(w) & ~(uint64_t)UINT32_MAX;
    return w + (uint64_t)((dahl_product_t)z * (((uint64_t)g.hi << 32) + g.lo) >> 64);
}
#else
#define dahl_batch_forward dahl_forward
#endif

/* As dahl_step_large; where no gap is left, no further digit changes a bit. */
static inline uint64_t dahl_batch_far(const dahl_plan_t *plan, uint64_t w, uint32_t size)
{
    w = dahl_batch_forward(w, plan->g[size % DAHL_DIRECT_COUNTS_MAX]);
    for (uint32_t rest = size / DAHL_DIRECT_COUNTS_MAX; rest != 0 && dahl_batch_gap(w) >> 32 != 0; rest &= rest - 1u) {
        uint32_t digit = 31u - dahl_leading_zeros(rest & (0u - rest));
        w = dahl_batch_forward(w, plan->g[DAHL_DIRECT_COUNTS_MAX + digit]);
    }
    return w;
}

static inline uint64_t dahl_batch_move(const dahl_plan_t *plan, uint64_t w, int32_t dcounts)
{
    uint64_t backward = dahl_batch_backward(dcounts);
    uint32_t size = dahl_batch_size(dcounts);
    w ^= backward;
    w = DAHL_LIKELY(size <= DAHL_DIRECT_COUNTS_MAX) ? dahl_batch_forward(w, plan->g[size]) : dahl_batch_far(plan, w, size);
    return w ^ backward;
}

typedef union {
    double value;
    uint64_t bits;
} dahl_double_t;

/* Fc 2^-62, exactly: the torque of w = 1 in Q62. */
static inline double dahl_batch_unit(const dahl_plan_t *plan)
{
    dahl_double_t power;
    power.bits = (uint64_t)(1023 - 62 + plan->Fc_exponent) << 52;
    return plan->Fc_mantissa == 0 ? 0 : (double)(plan->Fc_mantissa | 1u) * power.value;
}

/* As dahl_torque, by doubles: 32 bits of w from its first one on, times the same mantissa. The product errs by less than
 * 4 units in its last place, so rounding it to a float gives the right bits unless it lies that close to the middle between
 * two floats; there the integers decide. Where w has more than 53 bits, those that the 32 leave out anyway go first: so the
 * conversion to double never rounds. */
static inline dahl_double_t dahl_batch_product(int64_t w, double unit)
{
    dahl_double_t torque;
    uint64_t size = w < 0 ? 0u - (uint64_t)w : (uint64_t)w;
    size = size >> 53 != 0 ? size & ~(uint64_t)1023 : size;
    torque.value = (double)(int64_t)size;
    torque.bits &= ~(uint64_t)0x1fffff;
    torque.value *= unit;
    torque.bits |= (uint64_t)w & (uint64_t)1 << 63;
    return torque;
}

/* Its top bit says so: vectors have no cheaper form. */
static inline uint64_t dahl_batch_close(dahl_double_t torque)
{
    return ((torque.bits - 0xffffffcu) & 0x1fffffffu) - 9u;
}

static inline float dahl_batch_torque(const dahl_plan_t *plan, int64_t w, double unit)
{
    dahl_double_t torque = dahl_batch_product(w, unit);
    if (DAHL_LIKELY(dahl_batch_close(torque) >> 63 == 0)) {
        return (float)torque.value;
    }
    dahl_state_t state = {w};
    return dahl_torque(plan, &state);
}

#endif

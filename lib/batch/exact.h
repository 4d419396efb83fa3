/* SPDX-License-Identifier: MIT */
/** Common part of the exact batches: a tick by counts and its torque, on processors with fast doubles and 64-bit
 * words. The bits are those of bristle_update.h and torque.h, whose functions do the work. */
#ifndef DAHL_BATCH_EXACT_H
#define DAHL_BATCH_EXACT_H

#include <stdbool.h>
#include <stddef.h>
#include "cpu_dispatch.h"
#include "dahl_batch.h"
#include "../model/bristle_update.h"
#include "../model/torque.h"

/** All ones for backward. A backward move is a forward move of the complement (step_large.c), so no branch is
 * needed. */
static inline uint64_t dahl_batch_direction(int32_t dcounts)
{
    return 0u - (uint64_t)((uint32_t)dcounts >> 31);
}

static inline uint32_t dahl_batch_size(int32_t dcounts)
{
    return dcounts < 0 ? 0u - (uint32_t)dcounts : (uint32_t)dcounts;
}

/** Return 2^32 times the gap z plus less than one unit of z: 1 - dahl_q30(w) in one subtraction. The function is
 * its own inverse. */
static inline uint64_t dahl_batch_gap(uint64_t w)
{
    return DAHL_ONE_Q62 + 0x7fffffffu - w;
}

#if defined(__SIZEOF_INT128__)
__extension__ typedef unsigned __int128 dahl_product_t;

/** Return the gap that remains after a move; the fastest form of dahl_forward(). */
static inline uint64_t dahl_batch_shrink(uint64_t gap, dahl_q64_t g)
{
    uint64_t z = gap & ~(uint64_t)UINT32_MAX;
    return gap - (uint64_t)((dahl_product_t)z * (((uint64_t)g.hi << 32) + g.lo) >> 64);
}
#else
static inline uint64_t dahl_batch_shrink(uint64_t gap, dahl_q64_t g)
{
    return dahl_batch_gap(dahl_forward(dahl_batch_gap(gap), g));
}
#endif

/** Return the gap that remains after the lowest digit that is set. Without one, entry 0 leaves the gap
 * unchanged. */
static inline uint64_t dahl_batch_digit(const dahl_plan_t *plan, uint64_t gap, uint32_t rest)
{
    uint32_t digit = 31u - dahl_leading_zeros((rest & (0u - rest)) | 1u);
    return dahl_batch_shrink(gap, plan->g[rest != 0 ? DAHL_DIRECT_COUNTS_MAX + digit : 0u]);
}

/** The same as dahl_step_large(). If no gap remains, no further digit changes a bit. Keeping the gap instead of w
 * saves one dependent subtraction per digit. After the first digit, four at a time are processed, even if not set:
 * a mispredicted end of the loop costs more. */
static inline uint64_t dahl_batch_move_large(const dahl_plan_t *plan, uint64_t w, uint32_t size)
{
    uint32_t rest = size / DAHL_DIRECT_COUNTS_MAX;
    uint64_t gap = dahl_batch_shrink(dahl_batch_gap(w), plan->g[size % DAHL_DIRECT_COUNTS_MAX]);
    gap = dahl_batch_digit(plan, gap, rest);
    for (rest &= rest - 1u; rest != 0 && gap >> 32 != 0;) {
        DAHL_UNROLL_8
        for (int k = 0; k < 4; k++, rest &= rest - 1u) {
            gap = dahl_batch_digit(plan, gap, rest);
        }
    }
    return dahl_batch_gap(gap);
}

static inline uint64_t dahl_batch_move(const dahl_plan_t *plan, uint64_t w, uint32_t size)
{
    return DAHL_LIKELY(size <= DAHL_DIRECT_COUNTS_MAX) ? dahl_batch_gap(dahl_batch_shrink(dahl_batch_gap(w), plan->g[size]))
                                                       : dahl_batch_move_large(plan, w, size);
}

typedef union {
    double value;
    uint64_t bits;
} dahl_double_t;

/** Return Fc 2^-62 exactly: the torque of one unit of w. */
static inline double dahl_batch_unit(const dahl_plan_t *plan)
{
    dahl_double_t power;
    power.bits = (uint64_t)(1023 - 62 + plan->Fc_exponent) << 52;
    return plan->Fc_mantissa == 0 ? 0 : (double)(plan->Fc_mantissa | 1u) * power.value;
}

/** Convert an integer below 2^63 that a double can represent, from its halves. In any order of the additions,
 * nothing is rounded. */
static inline double dahl_batch_from_halves(uint64_t size)
{
    return (double)(int32_t)(size >> 32) * 0x1p32 + (double)(int32_t)((uint32_t)size ^ 0x80000000u) + 0x1p31;
}

/** Return the torque of dahl_torque() in double: the 32 leading bits of w times the same mantissa. The error is
 * less than 4 units in the last place. Rounding to float gives the right bits unless the product is that close to
 * the middle of two floats; then the integers decide. If w has more than 53 bits, bits that are not needed are
 * dropped first, so the conversion to double never rounds. */
static inline DAHL_ALWAYS_INLINE dahl_double_t dahl_batch_product(int64_t w, double unit, bool converts)
{
    dahl_double_t torque;
    uint64_t size = w < 0 ? 0u - (uint64_t)w : (uint64_t)w;
    size = size >> 53 != 0 ? size & ~(uint64_t)1023 : size;
    torque.value = converts ? (double)(int64_t)size : dahl_batch_from_halves(size);
    torque.bits &= ~(uint64_t)0x1fffff;
    torque.value *= unit;
    torque.bits |= (uint64_t)w & (uint64_t)1 << 63;
    return torque;
}

/** The top bit of the result is set if the product is close to the middle; vectors have no cheaper form. */
static inline uint64_t dahl_batch_near_tie(dahl_double_t torque)
{
    return ((torque.bits - 0xffffffcu) & 0x1fffffffu) - 9u;
}

/** Compute the torques of n states. apart = 1: each has its own plan; apart = 0: all share one. unit is from
 * dahl_batch_unit(). */
DAHL_INLINE void dahl_batch_torques(const dahl_plan_t *plans, const double *unit, size_t apart, const int64_t *w, float *F,
                                    size_t n, bool converts)
{
    uint64_t near_tie = 0;
    DAHL_AS_VECTORS
    for (size_t i = 0; i < n; i++) {
        dahl_double_t torque = dahl_batch_product(w[i], unit[i * apart], converts);
        F[i] = (float)torque.value;
        near_tie |= dahl_batch_near_tie(torque);
        near_tie |= unit[i * apart] > 0 ? 0u : (uint64_t)1 << 63; /* a plan of all zeros must not give -0 */
    }
    for (size_t i = 0; i < n && near_tie >> 63 != 0; i++) {
        dahl_state_t state = {w[i]};
        F[i] = dahl_torque(&plans[i * apart], &state);
    }
}

#endif

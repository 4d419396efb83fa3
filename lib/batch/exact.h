/* SPDX-License-Identifier: MIT */
/*
 * What the bitwise batches share, private: a tick by counts and its torque, for processors with fast doubles and 64-bit
 * words. The bits are those of bristle_update.h and torque.h, whose functions do the work.
 */
#ifndef DAHL_BATCH_EXACT_H
#define DAHL_BATCH_EXACT_H

#include <stdbool.h>
#include <stddef.h>
#include "cpu_dispatch.h"
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

/* 2^32 times the gap z, and less than a unit of z: as 1 - dahl_q30(w), in one subtraction; and back, by the same. */
static inline uint64_t dahl_batch_gap(uint64_t w)
{
    return DAHL_ONE_Q62 + 0x7fffffffu - w;
}

#if defined(__SIZEOF_INT128__)
__extension__ typedef unsigned __int128 dahl_product_t;

/* What a move leaves of a gap, as dahl_forward, in the least time. */
static inline uint64_t dahl_batch_less(uint64_t gap, dahl_q64_t g)
{
    uint64_t z = gap & ~(uint64_t)UINT32_MAX;
    return gap - (uint64_t)((dahl_product_t)z * (((uint64_t)g.hi << 32) + g.lo) >> 64);
}
#else
static inline uint64_t dahl_batch_less(uint64_t gap, dahl_q64_t g)
{
    return dahl_batch_gap(dahl_forward(dahl_batch_gap(gap), g));
}
#endif

/* What the lowest digit that is set leaves of a gap; where none is, the entry of no count leaves all. */
static inline uint64_t dahl_batch_digit(const dahl_plan_t *plan, uint64_t gap, uint32_t rest)
{
    uint32_t digit = 31u - dahl_leading_zeros((rest & (0u - rest)) | 1u);
    return dahl_batch_less(gap, plan->g[rest != 0 ? DAHL_DIRECT_COUNTS_MAX + digit : 0u]);
}

/* As dahl_step_large; where no gap is left, no further digit changes a bit. From digit to digit the gap is kept, not w: one
 * subtraction less to wait for. After the first digit four at a time, those that are not set too: a processor that foresees
 * the end of the loop wrongly loses more time than they take. */
static inline uint64_t dahl_batch_far(const dahl_plan_t *plan, uint64_t w, uint32_t size)
{
    uint32_t rest = size / DAHL_DIRECT_COUNTS_MAX;
    uint64_t gap = dahl_batch_less(dahl_batch_gap(w), plan->g[size % DAHL_DIRECT_COUNTS_MAX]);
    gap = dahl_batch_digit(plan, gap, rest);
    for (rest &= rest - 1u; rest != 0 && gap >> 32 != 0;) {
        DAHL_UNROLL_8
        for (int k = 0; k < 4; k++, rest &= rest - 1u) {
            gap = dahl_batch_digit(plan, gap, rest);
        }
    }
    return dahl_batch_gap(gap);
}

/* A move forward by so many counts. */
static inline uint64_t dahl_batch_move(const dahl_plan_t *plan, uint64_t w, uint32_t size)
{
    return DAHL_LIKELY(size <= DAHL_DIRECT_COUNTS_MAX) ? dahl_batch_gap(dahl_batch_less(dahl_batch_gap(w), plan->g[size]))
                                                       : dahl_batch_far(plan, w, size);
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

/* A whole number below 2^63 that a double has, from its halves: in whatever order these are added, nothing is rounded. */
static inline double dahl_batch_from_halves(uint64_t size)
{
    return (double)(int32_t)(size >> 32) * 0x1p32 + (double)(int32_t)((uint32_t)size ^ 0x80000000u) + 0x1p31;
}

/* As dahl_torque, by doubles: 32 bits of w from its first one on, times the same mantissa. The product errs by less than
 * 4 units in its last place, so rounding it to a float gives the right bits unless it lies that close to the middle between
 * two floats; there the integers decide. Where w has more than 53 bits, those that the 32 leave out anyway go first: so the
 * conversion to double never rounds, whether the instruction set has one or not. */
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

/* Its top bit says so: vectors have no cheaper form. */
static inline uint64_t dahl_batch_close(dahl_double_t torque)
{
    return ((torque.bits - 0xffffffcu) & 0x1fffffffu) - 9u;
}

/* The torques of n states, each of its own plan (apart = 1) or all of one (apart = 0); unit as of dahl_batch_unit. */
DAHL_INLINE void dahl_batch_torques(const dahl_plan_t *plans, const double *unit, size_t apart, const int64_t *w, float *F,
                                    size_t n, bool converts)
{
    uint64_t close = 0;
    DAHL_AS_VECTORS
    for (size_t i = 0; i < n; i++) {
        dahl_double_t torque = dahl_batch_product(w[i], unit[i * apart], converts);
        F[i] = (float)torque.value;
        close |= dahl_batch_close(torque);
        close |= unit[i * apart] > 0 ? 0u : (uint64_t)1 << 63; /* a plan of zeros: no negative zero */
    }
    for (size_t i = 0; i < n && close >> 63 != 0; i++) {
        dahl_state_t state = {w[i]};
        F[i] = dahl_torque(&plans[i * apart], &state);
    }
}

#endif

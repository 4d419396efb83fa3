/* SPDX-License-Identifier: MIT */
/*
 * The throughput forms, private: the recurrence in double, many ticks or channels at a time. Not the bits of the bitwise
 * forms, the same bound, for any motion:
 *   kernel   g(u) = u P(u), relative error 2.1e-10 (fast_kernel.py; short travel by fewer terms): at most twice that in
 *            F/Fc, for ever
 *   block    within a block of ticks only d = w - w0 is computed, w0 the state at its start: d, and what its rounding loses,
 *            is small where travel is small, at most 2^-53 (ticks of a block) u for each tick of travel u
 *   carry    from block to block the state is w in Q62: what cutting to 2^-61 loses sums up to 2^-31 at worst, for a block
 *            of travel 2^-30: within 0.01 ulp
 */
#ifndef DAHL_BATCH_FAST_H
#define DAHL_BATCH_FAST_H

#include <math.h> /* fabs and copysign, which compilers do in line */
#include <stdbool.h>
#include <stddef.h>

#include "cpu_dispatch.h"
#include "../model/bristle_update.h"
#include "dahl_batch.h"

#define DAHL_ALL 709.5 /* travel that leaves nothing of the gap: its 2^-k is 0 as a double; an infinite one is cut here */
#define DAHL_LN2 0x1.62e42fefa39efp-1
#define DAHL_LOG2E 0x1.71547652b82fep+0

typedef union {
    double value;
    uint64_t bits;
} dahl_double_t;

/* Bounds of the kernels' relative error: any travel and up to ln 2; up to ln 2/128. The tests read them. */
#define DAHL_G_ERROR 2.11e-10
#define DAHL_G_ERROR_TINY 7.3e-12

/* x signed travel: g(|x|) with the sign of x. */
typedef double (*dahl_g_t)(double x);

/* (1 - exp(-x))/x for 0 <= x <= ln 2, of a double or of a vector of them. Coefficients: fast_kernel.py. */
#define DAHL_SLOPE(x)                                                                                            \
    ((((((0x1.338b5a271ae80p-13 * (x) - 0x1.5fb71abddd792p-10) * (x) + 0x1.10587edb2864ap-7) * (x)               \
        - 0x1.554a20f68fa7bp-5) * (x) + 0x1.5555018e47e72p-3) * (x) - 0x1.fffffe257b105p-2) * (x) + 0x1.fffffffe43b48p-1)

/* The same for 0 <= x <= ln 2/128: four terms of the series, which leave out x^4/120 of g at most, 7.2e-12. */
#define DAHL_TINY_SLOPE(x) (((1.0 / 6 - (x) * (1.0 / 24)) * (x) - 0.5) * (x) + 1.0)

DAHL_INLINE double dahl_g_small(double x)
{
    double u = fabs(x);
    return x * DAHL_SLOPE(u);
}

DAHL_INLINE double dahl_g_tiny(double x)
{
    double u = fabs(x);
    return x * DAHL_TINY_SLOPE(u);
}

/* |x| = u = k ln 2 + r: g = 1 - 2^-k exp(-r). Cut where nothing is left of the gap. */
DAHL_INLINE double dahl_g_any(double x)
{
    dahl_double_t power;
    double u = fabs(x) < DAHL_ALL ? fabs(x) : DAHL_ALL;
    int32_t k = (int32_t)(u * DAHL_LOG2E);
    double r = u - (double)k * DAHL_LN2;
    power.bits = (uint64_t)(int64_t)(1023 - k) << 52;
    double g = r * DAHL_SLOPE(r);
    return copysign((uint32_t)k == 0u ? g : 1.0 - power.value * (1.0 - g), x); /* no difference where it could cancel */
}

/* A move as the input has it: its value, 0 for NaN, and a measure of its size that NaN makes largest. */
typedef double (*dahl_value_t)(const void *moves, size_t i);
typedef uint32_t (*dahl_measure_t)(const void *moves, size_t i);

DAHL_INLINE double dahl_value_of_count(const void *moves, size_t i)
{
    return (double)((const int32_t *)moves)[i];
}

DAHL_INLINE uint32_t dahl_measure_of_count(const void *moves, size_t i)
{
    int32_t n = ((const int32_t *)moves)[i];
    return n < 0 ? 0u - (uint32_t)n : (uint32_t)n;
}

DAHL_INLINE uint32_t dahl_measure_of_angle(const void *moves, size_t i)
{
    return dahl_bits_of(((const float *)moves)[i]) & 0x7fffffffu;
}

/* NaN is seen by its bits, so that -ffast-math does not lose it. */
DAHL_INLINE double dahl_value_of_angle(const void *moves, size_t i)
{
    return dahl_measure_of_angle(moves, i) > 0x7f800000u ? 0.0 : (double)((const float *)moves)[i];
}

/* The same where no move is NaN: a measure that is small enough says so. */
DAHL_INLINE double dahl_number_of_angle(const void *moves, size_t i)
{
    return (double)((const float *)moves)[i];
}

/* Once a call: each block leaves a state in range. */
DAHL_INLINE void dahl_clamp_state(dahl_state_t *state)
{
    state->w = (int64_t)dahl_clamp((uint64_t)state->w);
}

DAHL_INLINE double dahl_w_of(const dahl_state_t *state)
{
    return (double)state->w * 0x1p-62;
}

/* w += d, |d| <= 2, kept within +-1. */
DAHL_INLINE void dahl_carry(dahl_state_t *state, double d)
{
    const int64_t one = (int64_t)1 << 62;
    int64_t half = (int64_t)(d * 0x1p61); /* added twice: from -1 to 1 the whole would not fit */
    int64_t w = state->w + half + half;
    state->w = w > one ? one : w < -one ? -one : w;
}

/* What a call was given, checked: travel of one unit of the input, and Fc. */
typedef struct {
    double a;
    double Fc;
    uint32_t small; /* the measure up to which the travel is at most ln 2 */
    uint32_t tiny;  /* and ln 2/128 */
} dahl_throughput_scale_t;

dahl_err_t dahl_throughput_check(const dahl_throughput_params_t *params, bool by_counts, dahl_throughput_scale_t *scale);

#endif

/* SPDX-License-Identifier: MIT */
/**
 * Throughput forms: the recurrence in double, many ticks or channels at a time. Other bits than the exact forms,
 * the same error bound for any motion:
 * - kernel: g(u) = u P(u), relative error 2.1e-10 (throughput_kernel.py; fewer terms for short travel). As 1 minus a power
 *   of 2 (wide.h) it errs by 2.3e-10. The error of F/Fc is at most twice that.
 * - block: a block of ticks computes only d = w - w0, with w0 the state at its start. Rounding loses at most 2^-53
 *   (ticks of a block) u for each tick of travel u.
 * - absolute form: W = Fc w is the torque as a double. Its map W -> e W + c does not depend on the state, so a table of
 *   maps serves a whole call. A tick without motion is exact. Any other rounds W/Fc at most 9 times by 2^-54: e, c, and
 *   joined maps. Each later tick with motion forgets at least a part a of this, so the sum is at most 9 2^-54/a, with a the
 *   travel per count: .009 ulp for DAHL_ABSOLUTE_LEAST.
 * - carry: between blocks the state is w in Q62. Truncation to 2^-61 sums up to at most 2^-31, for a block of
 *   travel 2^-30: within 0.01 ulp.
 */
#ifndef DAHL_BATCH_THROUGHPUT_H
#define DAHL_BATCH_THROUGHPUT_H

#include <math.h> /* fabs and copysign, which compilers inline */
#include <stdbool.h>
#include <stddef.h>

#include "cpu_dispatch.h"
#include "../model/bristle_update.h"
#include "dahl_batch.h"

#define DAHL_ABSOLUTE_LEAST 0x1p-20 /* travel per count that the absolute form needs */
#define DAHL_ALL 60.0 /* travel that closes the gap: 1 - 2^-k is 1 as a double; also clamps infinity */
#define DAHL_LN2 0x1.62e42fefa39efp-1
#define DAHL_LOG2E 0x1.71547652b82fep+0

typedef union {
    double value;
    uint64_t bits;
} dahl_double_t;

/* Bounds of the relative error of g: for any travel, and for a travel up to ln 2/128. */
#define DAHL_G_ERROR 2.11e-10
#define DAHL_G_ERROR_TINY 7.3e-12

/** Returns g(|x|) with the sign of the travel x. */
typedef double (*dahl_g_t)(double x);

/* (1 - exp(-x))/x for 0 <= x <= ln 2, for a double or a vector of doubles. Coefficients: throughput_kernel.py. */
#define DAHL_SLOPE(x)                                                                                            \
    ((((((0x1.338b5a271ae80p-13 * (x) - 0x1.5fb71abddd792p-10) * (x) + 0x1.10587edb2864ap-7) * (x)               \
        - 0x1.554a20f68fa7bp-5) * (x) + 0x1.5555018e47e72p-3) * (x) - 0x1.fffffe257b105p-2) * (x) + 0x1.fffffffe43b48p-1)

/* The same for 0 <= x <= ln 2/128: four terms of the series, which omit at most x^4/120 of g, 7.2e-12. */
#define DAHL_TINY_SLOPE(x) (((1.0 / 6 - (x) * (1.0 / 24)) * (x) - 0.5) * (x) + 1.0)

/* 2^-(f/16) for 0 <= f <= 1: 1 minus f times a slope with the relative error DAHL_ROOT_ERROR, so it is exact at 0. And
 * 2^-(j/16) for j = 0 .. 15. Both: throughput_kernel.py. */
#define DAHL_ROOT_ERROR 2.29e-10
#define DAHL_ROOT_POWER(f)                                                                                       \
    ((((0x1.35c122ecb9e12p-23 * (f) - 0x1.c6a30bc829113p-17) * (f) + 0x1.ebfbd52835c7fp-11) * (f)                \
        - 0x1.62e42fee489cep-5) * (f) + 1.0)
#define DAHL_ROOTS_OF_E (16 * DAHL_LOG2E) /* in a travel of 1 */
#define DAHL_ROOTS                                                                                               \
    0x1.0000000000000p+0, 0x1.ea4afa2a490dap-1, 0x1.d5818dcfba487p-1, 0x1.c199bdd85529cp-1,                      \
    0x1.ae89f995ad3adp-1, 0x1.9c49182a3f090p-1, 0x1.8ace5422aa0dbp-1, 0x1.7a11473eb0187p-1,                      \
    0x1.6a09e667f3bcdp-1, 0x1.5ab07dd485429p-1, 0x1.4bfdad5362a27p-1, 0x1.3dea64c123422p-1,                      \
    0x1.306fe0a31b715p-1, 0x1.2387a6e756238p-1, 0x1.172b83c7d517bp-1, 0x1.0b5586cf9890fp-1

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

/** |x| = u = k ln 2 + r: g = 1 - 2^-k exp(-r). u is clamped to the travel that closes the gap. */
DAHL_INLINE double dahl_g_any(double x)
{
    dahl_double_t power;
    double u = fabs(x) < DAHL_ALL ? fabs(x) : DAHL_ALL;
    int32_t k = (int32_t)(u * DAHL_LOG2E);
    double r = u - (double)k * DAHL_LN2;
    power.bits = (uint64_t)(int64_t)(1023 - k) << 52;
    double g = r * DAHL_SLOPE(r);
    return copysign((uint32_t)k == 0u ? g : 1.0 - power.value * (1.0 - g), x); /* k = 0: a difference could cancel */
}

/** A move of the input: its value, 0 for NaN, and a measure of its size, largest for NaN. */
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

/** Detect NaN by its bits, since -ffast-math may ignore it. */
DAHL_INLINE double dahl_value_of_angle(const void *moves, size_t i)
{
    return dahl_measure_of_angle(moves, i) > 0x7f800000u ? 0.0 : (double)((const float *)moves)[i];
}

/** The same if no move is NaN, which a small enough measure proves. */
DAHL_INLINE double dahl_number_of_angle(const void *moves, size_t i)
{
    return (double)((const float *)moves)[i];
}

DAHL_INLINE void dahl_clamp_state(dahl_state_t *state)
{
    state->w = (int64_t)dahl_clamp((uint64_t)state->w);
}

/** w as a double, at most 1 - 2^-53. So c = (s - w) g is not 0 while the shaft moves, and d = e d + c never becomes a
 * subnormal number. Such a number takes some processors 100 cycles. */
DAHL_INLINE double dahl_w_of(const dahl_state_t *state)
{
    return (double)state->w * 0x1.fffffffffffffp-63;
}

/** w += d, for |d| <= 2, clamped to +-1. */
DAHL_INLINE void dahl_carry(dahl_state_t *state, double d)
{
    const int64_t one = (int64_t)1 << 62;
    int64_t half = (int64_t)(d * 0x1p61); /* added twice: a d from -1 to 1 does not fit in Q62 */
    int64_t w = state->w + half + half;
    state->w = w > one ? one : w < -one ? -one : w;
}

/** Checked parameters of a call: travel of one unit of the input, and Fc. */
typedef struct {
    double a;
    double Fc;
    uint32_t small; /* largest measure with a travel of at most ln 2 */
    uint32_t tiny;  /* largest measure with a travel of at most ln 2/128 */
} dahl_throughput_scale_t;

dahl_err_t dahl_throughput_check(const dahl_throughput_params_t *params, bool by_counts, dahl_throughput_scale_t *scale);

#endif

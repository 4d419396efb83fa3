/* SPDX-License-Identifier: MIT */
/** For prepare functions: checks, codes, and sums, products and quotients of parameters as mantissa 2^exponent of 32 bits. */
#ifndef DAHL_REAL_H
#define DAHL_REAL_H

#include "../arith/fixed.h"
#include "../model/check_params.h"
#include "dahl_compensator.h"

/** Return the code of a dahl_err_t. */
static inline dahl_compensator_err_t dahl_compensator_code_of(int32_t err)
{
    return err == DAHL_OK ? DAHL_COMPENSATOR_OK : err == DAHL_ERR_RANGE ? DAHL_COMPENSATOR_RANGE : DAHL_COMPENSATOR_PARAM;
}

/** Inline at each level of optimization, because gcc for Cortex-M0 copies a returned structure with memcpy. */
static inline DAHL_ALWAYS_INLINE dahl_real_t dahl_real_of_param(float x)
{
    const uint32_t bits = dahl_bits_of(x);
    dahl_real_t real = {DAHL_TOP_BIT | bits << 8, (int32_t)(bits >> 23) - (127 + 31)};
    return real;
}

static inline int dahl_is_zero(float x)
{
    return dahl_bits_of(x) << 1 == 0;
}

static inline dahl_real_t dahl_real_round_down(uint64_t mantissa, int32_t exponent)
{
    dahl_wide_t wide = dahl_normalise(mantissa, exponent);
    dahl_real_t real = {(uint32_t)(wide.mantissa >> 32), wide.exponent + 32};
    return real;
}

/** Return a code of dahl_err_t. The OR of several is the most severe one. */
static inline DAHL_COLD int32_t dahl_check_value(float value, int may_be_zero)
{
    const uint32_t bits = dahl_bits_of(value);
    if (dahl_is_zero(value)) {
        return may_be_zero ? DAHL_OK : DAHL_ERR_PARAM;
    }
    if (bits >= DAHL_BITS_INF) { /* infinite, NaN, or negative */
        return DAHL_ERR_PARAM;
    }
    return dahl_bits_of(DAHL_TORQUE_MIN) <= bits && bits < dahl_bits_of(DAHL_TORQUE_MAX) ? DAHL_OK : DAHL_ERR_RANGE;
}

static inline DAHL_COLD dahl_real_t dahl_real_multiply(dahl_real_t a, dahl_real_t b)
{
    return dahl_real_round_down(dahl_mul(a.mantissa, b.mantissa), a.exponent + b.exponent);
}

static inline DAHL_COLD dahl_real_t dahl_real_divide(dahl_real_t a, dahl_real_t b)
{
    return dahl_real_round_down(dahl_quotient_q63(a.mantissa, b.mantissa), a.exponent - b.exponent - 63);
}

/** Return x 2^bits, truncated, at most `most`. */
static inline uint32_t dahl_real_to_fixed(dahl_real_t x, int32_t bits, uint32_t most)
{
    int32_t shift = -(x.exponent + bits);
    uint32_t fixed = shift > 31 ? 0 : shift < 0 ? UINT32_MAX : x.mantissa >> shift;
    return fixed < most ? fixed : most;
}

/** Return the power of two of ticks that lasts `time`, or down to half of it; at most `most`. */
static inline DAHL_COLD uint8_t dahl_real_doublings(float time, dahl_real_t period, uint8_t most)
{
    uint32_t ticks = dahl_real_to_fixed(dahl_real_divide(dahl_real_of_param(time), period), 0, UINT32_MAX);
    uint8_t shift = 0;
    while (shift < most && ticks >> shift > 1) {
        shift++;
    }
    return shift;
}

/** Return the speed of one count per tick as a part of `speed`, in Q20. */
static inline DAHL_COLD uint32_t dahl_real_speed_unit(dahl_real_t speed, dahl_real_t period, dahl_real_t theta)
{
    return dahl_real_to_fixed(dahl_real_divide(theta, dahl_real_multiply(speed, period)), 20, DAHL_ONE_Q30);
}

/** Return x 2^(30 - shift), truncated. A loop, because Cortex-M0 would call a helper function for the shift. */
static inline DAHL_COLD uint64_t dahl_real_shift(dahl_real_t x, int32_t shift)
{
    uint64_t bits = (uint64_t)x.mantissa << 30;
    for (; shift > 0 && bits != 0; shift--) {
        bits >>= 1;
    }
    return bits;
}

/** Return a + b as a mantissa of 30 or 31 bits, rounded up by at most 2^-29 of the sum. */
static inline DAHL_COLD dahl_real_t dahl_real_add_up(dahl_real_t a, dahl_real_t b)
{
    const dahl_real_t large = a.exponent < b.exponent ? b : a, little = a.exponent < b.exponent ? a : b;
    uint64_t sum = dahl_real_shift(large, 0) + dahl_real_shift(little, large.exponent - little.exponent);
    dahl_real_t real = {(uint32_t)(sum >> 32) + 1, large.exponent + 2};
    return real;
}

/** Return a - b, rounded down by less than 2^-30 of it, for floats a > b. Their lowest 8 bits are 0. */
static inline DAHL_COLD dahl_real_t dahl_real_subtract_down(dahl_real_t a, dahl_real_t b)
{
    const int32_t shift = a.exponent - b.exponent;
    return dahl_real_round_down(dahl_real_shift(a, 0) - dahl_real_shift(b, shift) - (shift > 38), a.exponent - 30);
}

/** Return x^2 of such a sum, rounded up by at most 2^-27 of the square. */
static inline DAHL_COLD dahl_real_t dahl_real_square_up(dahl_real_t x)
{
    dahl_real_t real = {(uint32_t)(dahl_mul(x.mantissa, x.mantissa) >> 31) + 1, 2 * x.exponent + 31};
    return real;
}

static inline int dahl_wide_is_above(dahl_wide_t a, dahl_wide_t b)
{
    return a.exponent != b.exponent ? a.exponent > b.exponent : a.mantissa > b.mantissa;
}

/** Return true if a b > c, decided exactly. */
static inline int dahl_real_is_product_above(dahl_real_t a, dahl_real_t b, dahl_real_t c)
{
    const dahl_wide_t wide = {(uint64_t)c.mantissa << 32, c.exponent - 32};
    return dahl_wide_is_above(dahl_normalise(dahl_mul(a.mantissa, b.mantissa), a.exponent + b.exponent), wide);
}

#endif

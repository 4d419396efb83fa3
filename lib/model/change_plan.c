/* SPDX-License-Identifier: MIT */
/*
 * New parameters between two ticks. Keeping F means w *= Fc_from/Fc_to; keeping the deflection F/sigma0 of the bristle
 * means w *= a_to/a_from. Their ratio is sigma0_to/sigma0_from, so the smaller of the two keeps F unless the bristle got
 * softer; neither lets the stored energy F^2/(2 sigma0) grow. Rounding does not either: the first factor is truncated, so
 * F never grows, and the second errs by 2^-30 where float values of sigma0 differ by 2^-24 or not at all.
 */
#include "../arith/fixed.h"

typedef struct {
    uint64_t mantissa; /* Q63, in [1, 2) */
    int32_t exponent;
} factor_t;

static factor_t factor_of(uint32_t n, int32_t n_exponent, uint32_t d, int32_t d_exponent)
{
    factor_t f;
    f.mantissa = dahl_quotient_q63(n, d);
    f.exponent = n_exponent - d_exponent;
    if (!(f.mantissa >> 63)) {
        f.mantissa <<= 1;
        f.exponent--;
    }
    return f;
}

static factor_t smaller(factor_t x, factor_t y)
{
    int x_first = x.exponent != y.exponent ? x.exponent < y.exponent : x.mantissa < y.mantissa;
    return x_first ? x : y;
}

/* size times f in Q62, clamped to 1; size <= 1 too, but for the 2^31 that a step may pass it by. */
static uint64_t scaled(uint64_t size, factor_t f)
{
    uint64_t product = dahl_mulhi64(size << 1, f.mantissa);
    int32_t shift = f.exponent;
    if (shift <= 0) {
        product >>= shift < -63 ? 63 : -shift; /* below 2^63: f.mantissa < 2^64 - 2^32 */
    } else {
        product = shift > 62 || product > (DAHL_ONE_Q62 >> shift) ? DAHL_ONE_Q62 : product << shift;
    }
    return product > DAHL_ONE_Q62 ? DAHL_ONE_Q62 : product;
}

void dahl_change_plan(const dahl_plan_t *from, const dahl_plan_t *to, dahl_state_t *state)
{
    factor_t keep_F = factor_of(dahl_mantissa_of_Fc(from), dahl_exponent_of_Fc(from), dahl_mantissa_of_Fc(to), dahl_exponent_of_Fc(to));
    factor_t keep_deflection = factor_of(to->a_mantissa, dahl_exponent_of_a(to), from->a_mantissa, dahl_exponent_of_a(from));
    uint64_t size = state->w < 0 ? 0u - (uint64_t)state->w : (uint64_t)state->w;
    uint64_t w = size ? scaled(size, smaller(keep_F, keep_deflection)) : 0;
    state->w = (int64_t)(state->w < 0 ? 0u - w : w);
}

/* SPDX-License-Identifier: MIT */
/**
 * New parameters between two ticks.
 *
 * Keeping F means w *= Fc_from/Fc_to. Keeping the deflection F/sigma0 of the bristle means w *= a_to/a_from. The
 * smaller factor keeps F unless the bristle became softer, so the energy F^2/(2 sigma0) does not grow. Rounding
 * does not increase it either. The first factor is truncated. The second is wrong by at most 2^-30, but float
 * values of sigma0 differ by at least 2^-24 or not at all.
 */
#include "../arith/fixed.h"
#include "dahl.h"
#include "kernel.h"

static dahl_wide_t quotient_of_scaled(uint32_t n, int32_t n_exponent, uint32_t d, int32_t d_exponent)
{
    return dahl_normalise(dahl_quotient_q63(n, d), n_exponent - d_exponent - 63);
}

static dahl_wide_t minimum(dahl_wide_t x, dahl_wide_t y)
{
    int is_x_smaller = x.exponent != y.exponent ? x.exponent < y.exponent : x.mantissa < y.mantissa;
    return is_x_smaller ? x : y;
}

/** Return size (> 0, Q62) times f, truncated and clamped to 1. */
static uint64_t scale(uint64_t size, dahl_wide_t f)
{
    dahl_wide_t s = dahl_normalise(size, 0);
    uint64_t product = dahl_mulhi64(s.mantissa, f.mantissa);
    int32_t shift = -64 - s.exponent - f.exponent;
    if (shift < 0) {
        return DAHL_ONE_Q62;
    }
    product = shift > 63 ? 0 : product >> shift;
    return product > DAHL_ONE_Q62 ? DAHL_ONE_Q62 : product;
}

void dahl_change_plan(const dahl_plan_t *from, const dahl_plan_t *to, dahl_state_t *state)
{
    uint64_t w = (uint64_t)state->w, size = state->w < 0 ? 0u - w : w;
    if (size == 0 || from->Fc_mantissa == 0 || to->Fc_mantissa == 0) { /* no torque, or a plan of all zeros */
        state->w = 0;
        return;
    }
    dahl_wide_t keep_F = quotient_of_scaled(from->Fc_mantissa, from->Fc_exponent, to->Fc_mantissa, to->Fc_exponent);
    dahl_wide_t keep_deflection =
        quotient_of_scaled(to->a_mantissa, dahl_a_exponent(to), from->a_mantissa, dahl_a_exponent(from));
    size = scale(size < DAHL_ONE_Q62 ? size : DAHL_ONE_Q62, minimum(keep_F, keep_deflection));
    state->w = (int64_t)(state->w < 0 ? 0u - size : size);
}

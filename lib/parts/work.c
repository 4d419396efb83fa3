/* SPDX-License-Identifier: MIT */
/**
 * Work of a Dahl element. In one direction s = +-1 of travel, Eq. 1 gives F dtheta = Fc s dtheta - (Fc^2/sigma0) s
 * dw. Hence
 * @verbatim
 *     work = Fc |dtheta| - (Fc^2/sigma0) s (w_after - w_before)
 * @endverbatim
 * Two sums of integers are enough: the counts travelled, and the path of w in the direction of travel, which is
 * never negative. Each tick adds exactly the change of the state; only reading rounds. 96 and 128 bits hold 2^63
 * ticks.
 */
#include "../arith/fixed.h"
#include "dahl_parts.h"

/** Return the 64 leading bits of a sum whose highest word is words[top]. */
static dahl_wide_t leading_bits(const uint32_t *words, int top)
{
    dahl_wide_t zero = {0, 0};
    while (top > 0 && words[top] == 0) {
        top--;
    }
    if (words[top] == 0) {
        return zero;
    }
    uint64_t two = (uint64_t)words[top] << 32 | (top > 0 ? words[top - 1] : 0);
    uint32_t below = top > 1 ? words[top - 2] : 0, zeros = dahl_leading_zeros(words[top]);
    dahl_wide_t sum = {two << zeros | (uint64_t)below << zeros >> 32, 32 * (top - 1) - (int32_t)zeros};
    return sum;
}

static dahl_wide_t multiply(dahl_wide_t x, dahl_wide_t y)
{
    dahl_wide_t product = {dahl_mulhi64(x.mantissa, y.mantissa), x.exponent + y.exponent + 64};
    return product.mantissa == 0 ? product : dahl_normalise(product.mantissa, product.exponent);
}

static dahl_wide_t wide_of_float(float x)
{
    dahl_real_t real = dahl_real_of(dahl_bits_of(x));
    dahl_wide_t wide = {(uint64_t)real.mantissa << 32, real.exponent - 32};
    return wide;
}

static dahl_wide_t quotient_of_floats(float x, float y)
{
    dahl_real_t n = dahl_real_of(dahl_bits_of(x)), d = dahl_real_of(dahl_bits_of(y));
    return dahl_normalise(dahl_quotient_q63(n.mantissa, d.mantissa), n.exponent - d.exponent - 63);
}

static int is_less(dahl_wide_t x, dahl_wide_t y)
{
    if (x.mantissa == 0 || y.mantissa == 0 || x.exponent == y.exponent) {
        return x.mantissa < y.mantissa;
    }
    return x.exponent < y.exponent;
}

/** Return x - y, for x >= y. */
static dahl_wide_t difference(dahl_wide_t x, dahl_wide_t y)
{
    int32_t shift = x.exponent - y.exponent;
    uint64_t remainder = x.mantissa - (y.mantissa == 0 || shift > 63 ? 0 : y.mantissa >> shift);
    dahl_wide_t zero = {0, 0};
    return remainder == 0 ? zero : dahl_normalise(remainder, x.exponent);
}

/** Return the bits of the nearest float: infinite above the largest float, 0 below the least normal one. */
static uint32_t float_bits(dahl_wide_t x)
{
    int32_t exponent = x.exponent + 63;
    if (x.mantissa == 0 || exponent < -126) {
        return 0;
    }
    return exponent > 127 ? DAHL_BITS_INF : dahl_round_to_float((uint32_t)(x.mantissa >> 32), (uint32_t)(x.exponent + 32));
}

float dahl_work(const dahl_params_t *params, const dahl_work_t *work)
{
    dahl_wide_t way = leading_bits(work->way, 3), Fc = wide_of_float(params->Fc);
    way.exponent -= 62;
    dahl_wide_t coulomb_work = multiply(multiply(Fc, wide_of_float(params->theta_per_count)), leading_bits(work->counts, 2));
    dahl_wide_t bristle_work = multiply(multiply(Fc, quotient_of_floats(params->Fc, params->sigma0)), way);
    int is_negative = is_less(coulomb_work, bristle_work);
    uint32_t bits = float_bits(is_negative ? difference(bristle_work, coulomb_work) : difference(coulomb_work, bristle_work));
    return dahl_float_of(is_negative && bits != 0 ? bits | DAHL_BITS_SIGN : bits);
}

/* SPDX-License-Identifier: MIT */
/** Find parameters that are probably in a wrong unit. No float operation, as in dahl_prepare(). */
#include "check_params.h"

#define COARSEST_COUNT 1.6f      /* [rad] just above a quarter turn: four counts per turn */
#define COARSE_COUNT 7.8125e-3f  /* [rad] 2^-7: 46080 counts per turn, if it is in degrees */
#define DEGREES_Q26 (UINT32_C(45) << 26) /* mantissa of 360 */
#define SHORT_EXPONENT 4 /* of the travel of one count: 16 presliding lengths */
#define LONG_EXPONENT 7  /* of Fc/sigma0: 128 rad, 20 turns */

/** Return the leading 32 bits of 360/theta. */
static uint32_t counts_per_turn(dahl_real_t theta)
{
    uint64_t quotient = dahl_quotient_q63(DEGREES_Q26, theta.mantissa);
    return (uint32_t)(quotient >> 63 ? quotient >> 32 : quotient >> 31);
}

/** Return true if the bits below the leading ones are 0. The rounding of theta to a float moves the quotient by up to
 * 2^8. */
static int has_leading_bits(uint32_t quotient, int bits)
{
    return ((quotient + 0x100) & UINT32_MAX >> bits) <= 0x200;
}

/** Return true if 360/theta is a power of two, or a number that decimal encoders have: with at most 11 significant bits.
 * In rad, 360/theta has a fraction; in m, it has more bits, unless a count is longer than those of a linear axis. */
static int is_in_degrees(uint32_t theta)
{
    return has_leading_bits(counts_per_turn(dahl_real_of(theta)), theta < dahl_bits_of(COARSE_COUNT) ? 1 : 11);
}

static int is_presliding_long(dahl_real_t sigma0, dahl_real_t Fc)
{
    return Fc.exponent - sigma0.exponent - (Fc.mantissa < sigma0.mantissa) >= LONG_EXPONENT;
}

/** Return the remark on the encoder. */
static dahl_plausible_t check_count(const dahl_params_t *params, dahl_real_t sigma0, dahl_real_t Fc)
{
    const uint32_t theta = dahl_bits_of(params->theta_per_count);
    if (theta > dahl_bits_of(COARSEST_COUNT)) {
        return DAHL_COUNTS_PER_TURN;
    }
    if (is_in_degrees(theta)) {
        return DAHL_DEGREES_PER_COUNT;
    }
    return dahl_travel_exponent(sigma0, dahl_real_of(theta), Fc) >= SHORT_EXPONENT ? DAHL_SHORT_PRESLIDING : DAHL_PLAUSIBLE;
}

DAHL_COLD dahl_plausible_t dahl_params_plausible(const dahl_params_t *params)
{
    if (dahl_check_params(params) == DAHL_ERR_PARAM) {
        return DAHL_PLAUSIBLE;
    }
    const dahl_real_t sigma0 = dahl_real_of(dahl_bits_of(params->sigma0)), Fc = dahl_real_of(dahl_bits_of(params->Fc));
    const dahl_plausible_t remark = dahl_has_counts(params) ? check_count(params, sigma0, Fc) : DAHL_PLAUSIBLE;
    return remark == DAHL_PLAUSIBLE && is_presliding_long(sigma0, Fc) ? DAHL_LONG_PRESLIDING : remark;
}

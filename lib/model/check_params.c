/* SPDX-License-Identifier: MIT */
/** Exact check of the parameters of an element, in integers. */
#include "check_params.h"

#include "../arith/fixed.h"

/** The OR of several codes is the most severe one. */
static DAHL_OUT_OF_LINE DAHL_COLD int32_t check_param(uint32_t bits)
{
    const uint32_t least = dahl_bits_of(DAHL_TORQUE_MIN), most = dahl_bits_of(DAHL_TORQUE_MAX);
    if (bits == 0 || bits >= DAHL_BITS_INF) { /* zero, infinite, NaN, or negative */
        return DAHL_ERR_PARAM;
    }
    return least <= bits && bits < most ? DAHL_OK : DAHL_ERR_RANGE;
}

/** 2^-30 <= sigma0 theta/Fc < 2^20, decided exactly. */
static int is_travel_in_range(dahl_real_t sigma0, dahl_real_t theta, dahl_real_t Fc)
{
    int32_t exponent = dahl_travel_exponent(sigma0, theta, Fc);
    return -30 <= exponent && exponent < 20;
}

DAHL_COLD dahl_err_t dahl_check_params(const dahl_params_t *params)
{
    uint32_t sigma0 = dahl_bits_of(params->sigma0), Fc = dahl_bits_of(params->Fc);
    uint32_t theta = dahl_bits_of(params->theta_per_count);
    int has_counts = dahl_has_counts(params);
    int32_t err = check_param(sigma0) | check_param(Fc) | (has_counts ? check_param(theta) : DAHL_OK);
    if (err == DAHL_OK && has_counts && !is_travel_in_range(dahl_real_of(sigma0), dahl_real_of(theta), dahl_real_of(Fc))) {
        err = DAHL_ERR_RANGE;
    }
    return (dahl_err_t)err;
}

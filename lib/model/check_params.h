/* SPDX-License-Identifier: MIT */
/** Checks of all prepare functions. */
#ifndef DAHL_CHECK_PARAMS_H
#define DAHL_CHECK_PARAMS_H

#include "../arith/fixed.h"
#include "dahl.h"

/** Return true unless theta_per_count is +-0: a plan for angles only. */
static inline int dahl_has_counts(const dahl_params_t *params)
{
    return dahl_bits_of(params->theta_per_count) << 1 != 0;
}

/** Return the exponent of the travel of one count: 2^exponent <= sigma0 theta/Fc < 2^(exponent + 1), exactly. Comparing
 * the upper half of the product with the mantissa of Fc, and with half of it, gives the exponent of the quotient. */
static inline int32_t dahl_travel_exponent(dahl_real_t sigma0, dahl_real_t theta, dahl_real_t Fc)
{
    uint32_t high = dahl_mulhi(sigma0.mantissa, theta.mantissa);
    int32_t exponent = sigma0.exponent + theta.exponent - Fc.exponent + 30;
    return exponent + (high >= Fc.mantissa >> 1) + (high >= Fc.mantissa);
}

/** Return DAHL_OK if the parameters and the travel of one count are in range. theta_per_count may be 0. */
dahl_err_t dahl_check_params(const dahl_params_t *params);

/** The same for an element by counts: theta_per_count = 0 is rejected. */
static inline int32_t dahl_check_params_by_counts(const dahl_params_t *params)
{
    return dahl_check_params(params) | (dahl_has_counts(params) ? DAHL_OK : DAHL_ERR_PARAM);
}

#endif

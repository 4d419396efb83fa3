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

/** Return DAHL_OK if the parameters and the travel of one count are in range. theta_per_count may be 0. */
dahl_err_t dahl_check_params(const dahl_params_t *params);

/** The same for an element by counts: theta_per_count = 0 is rejected. */
static inline int32_t dahl_check_params_by_counts(const dahl_params_t *params)
{
    return dahl_check_params(params) | (dahl_has_counts(params) ? DAHL_OK : DAHL_ERR_PARAM);
}

#endif

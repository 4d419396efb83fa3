/* SPDX-License-Identifier: MIT */
/* What every prepare asks first, private. */
#ifndef DAHL_CHECK_PARAMS_H
#define DAHL_CHECK_PARAMS_H

#include "../arith/fixed.h"
#include "dahl.h"

/* theta_per_count may be 0, of either sign, where a plan is for angles alone. */
static inline int dahl_has_counts(const dahl_params_t *params)
{
    return dahl_bits_of(params->theta_per_count) << 1 != 0;
}

/* DAHL_OK iff each parameter, and the travel of one count, is in its range; theta_per_count may be 0. */
dahl_err_t dahl_check_params(const dahl_params_t *params);

/* The same for a part that is fed by counts alone: theta_per_count = 0 is refused too. */
static inline int32_t dahl_check_counted(const dahl_params_t *params)
{
    return dahl_check_params(params) | (dahl_has_counts(params) ? DAHL_OK : DAHL_ERR_PARAM);
}

#endif

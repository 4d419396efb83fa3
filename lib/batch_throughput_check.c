/* SPDX-License-Identifier: MIT */
/* The limits of dahl_prepare, for parameters in double. */
#include "batch_throughput.h"

static int is_positive(double x)
{
    return x > 0.0 && x <= 1.7976931348623157e308;
}

static int is_in(double x, double least, double most)
{
    return x >= least && x < most;
}

dahl_err_t dahl_throughput_check(const dahl_throughput_params_t *params, int by_counts, dahl_throughput_scale_t *scale)
{
    double theta = by_counts ? params->theta_per_count : 1.0;
    if (!is_positive(params->sigma0) || !is_positive(params->Fc) || !is_positive(theta)) {
        return DAHL_ERR_PARAM;
    }
    if (!is_in(params->sigma0, DAHL_TORQUE_MIN, DAHL_TORQUE_MAX) || !is_in(params->Fc, DAHL_TORQUE_MIN, DAHL_TORQUE_MAX)) {
        return DAHL_ERR_RANGE;
    }
    scale->Fc = params->Fc;
    scale->a = params->sigma0 / params->Fc * theta;
    return !by_counts || is_in(scale->a, DAHL_TRAVEL_MIN, DAHL_TRAVEL_MAX) ? DAHL_OK : DAHL_ERR_RANGE;
}

/* SPDX-License-Identifier: MIT */
/* The limits of dahl_prepare, for parameters in double. */
#include "fast.h"

/* By its bits, so that -ffast-math does not lose NaN. */
static int is_positive(double x)
{
    dahl_double_t as;
    as.value = x;
    return as.bits != 0 && as.bits < (uint64_t)0x7ff << 52;
}

static int is_in(double x, double least, double most)
{
    return x >= least && x < most;
}

static int is_torque(double x)
{
    return is_in(x, (double)DAHL_TORQUE_MIN, (double)DAHL_TORQUE_MAX);
}

/* A travel as counts, or as the bits of a float: rounding up by 2^-24 is within the kernels' range. By counts a >= 2^-30, by
 * angle a > 2^-128, so that a travel of ln 2 is no more than either can say. */
static uint32_t measure_of(double travel, double a, bool by_counts)
{
    double most = travel / a;
    return by_counts ? (uint32_t)most : dahl_bits_of((float)most);
}

dahl_err_t dahl_throughput_check(const dahl_throughput_params_t *params, bool by_counts, dahl_throughput_scale_t *scale)
{
    double theta = by_counts ? params->theta_per_count : 1.0;
    if (!is_positive(params->sigma0) || !is_positive(params->Fc) || !is_positive(theta)) {
        return DAHL_ERR_PARAM;
    }
    double a = params->sigma0 / params->Fc * theta;
    if (!is_torque(params->sigma0) || !is_torque(params->Fc) || !is_torque(theta)
        || (by_counts && !is_in(a, DAHL_TRAVEL_MIN, DAHL_TRAVEL_MAX))) {
        return DAHL_ERR_RANGE;
    }
    scale->a = a;
    scale->Fc = params->Fc;
    scale->small = measure_of(DAHL_LN2, a, by_counts);
    scale->tiny = measure_of(DAHL_LN2 / 128, a, by_counts);
    return DAHL_OK;
}

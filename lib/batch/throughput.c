/* SPDX-License-Identifier: MIT */
/** Check of parameters in double, with the limits of dahl_prepare(). */
#include "throughput.h"

/** Compare bits, since -ffast-math may ignore NaN. */
static int is_positive(double x)
{
    dahl_double_t as;
    as.value = x;
    return as.bits != 0 && as.bits < (uint64_t)0x7ff << 52;
}

static int is_torque(double x)
{
    return x >= (double)DAHL_TORQUE_MIN && x < (double)DAHL_TORQUE_MAX;
}

static dahl_wide_t wide_of_double(double x)
{
    dahl_double_t as;
    as.value = x;
    dahl_wide_t r = {(uint64_t)1 << 63 | as.bits << 11, (int32_t)(as.bits >> 52) - (1023 + 63)};
    return r;
}

/** Return true if DAHL_TRAVEL_MIN <= sigma0 theta/Fc < DAHL_TRAVEL_MAX, decided exactly as in check_params.c. The
 * lowest bits of the mantissa of a double are 0. */
static int is_double_travel_in_range(double sigma0, double theta, double Fc)
{
    dahl_wide_t s = wide_of_double(sigma0), t = wide_of_double(theta), f = wide_of_double(Fc);
    uint64_t high = dahl_mulhi64(s.mantissa, t.mantissa);
    int32_t exponent = s.exponent + t.exponent - f.exponent + 62;
    exponent += (high >= f.mantissa >> 1) + (high >= f.mantissa);
    return -30 <= exponent && exponent < 20;
}

/** Convert a travel to a measure: counts, or the bits of a float. Rounding up by 2^-24 is within the range of the
 * kernels. By counts a is about 2^-30 or more, by angle a > 2^-128, so a travel of ln 2 fits in both. */
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
    if (!is_torque(params->sigma0) || !is_torque(params->Fc) || !is_torque(theta)
        || (by_counts && !is_double_travel_in_range(params->sigma0, theta, params->Fc))) {
        return DAHL_ERR_RANGE;
    }
    double a = params->sigma0 / params->Fc * theta;
    scale->a = a;
    scale->Fc = params->Fc;
    scale->small = measure_of(DAHL_LN2, a, by_counts);
    scale->tiny = measure_of(DAHL_LN2 / 128, a, by_counts);
    return DAHL_OK;
}

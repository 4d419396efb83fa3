/* SPDX-License-Identifier: MIT */
/* Plans from 12 bytes, most of which dahl_prepare takes: exponents from the whole of its range, any mantissa. */
#ifndef FUZZ_PLANS_H
#define FUZZ_PLANS_H

#include <math.h>

#include "dahl.h"
#include "fuzz.h"

typedef struct {
    dahl_plan_t plan;
    dahl_params_t params;
    int good;
} fuzz_plan_t;

/* mantissa 2^exponent, the mantissa in [1, 2) from the low 23 bits. */
static inline float fuzz_scaled(uint32_t bits, int exponent)
{
    return ldexpf(fuzz_float_of(0x3f800000u | (bits & 0x7fffffu)), exponent);
}

/* Exponents of sigma0 and Fc by their top bits; that of theta_per_count so that a count travels 2^-31 to 2^20. */
static inline dahl_params_t fuzz_params(fuzz_bytes_t *bytes)
{
    uint32_t sigma0 = fuzz_u32(bytes), Fc = fuzz_u32(bytes), theta = fuzz_u32(bytes);
    int sigma0_exponent = (int)(sigma0 >> 23 & 127u) - 64, Fc_exponent = (int)(Fc >> 23 & 127u) - 64;
    int u_exponent = (int)((theta >> 23) % 52u) - 31;
    dahl_params_t params = {fuzz_scaled(sigma0, sigma0_exponent), fuzz_scaled(Fc, Fc_exponent),
                            fuzz_scaled(theta, u_exponent - sigma0_exponent + Fc_exponent)};
    if (!(params.theta_per_count < DAHL_TORQUE_MAX)) {
        params.theta_per_count = 0.0f;
    }
    return params;
}

/* Preparing takes longer than the steps: the last plan is kept for as long as its bytes stay. */
static inline const fuzz_plan_t *fuzz_plan(fuzz_bytes_t *bytes, fuzz_plan_t *kept)
{
    dahl_params_t params = fuzz_params(bytes);
    if (memcmp(&params, &kept->params, sizeof params) != 0) {
        kept->params = params;
        kept->good = dahl_prepare(&kept->plan, &params) == DAHL_OK;
    }
    return kept;
}

/* Travel of a move by the parameters themselves, in presliding lengths. */
static inline long double fuzz_travel(const dahl_params_t *params, long double theta)
{
    return fabsl(theta) * (long double)params->sigma0 / (long double)params->Fc;
}

#endif

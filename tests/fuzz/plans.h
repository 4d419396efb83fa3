/* SPDX-License-Identifier: MIT */
/* Plans from 12 bytes, most of them in range: exponents over the whole range, any mantissa. */
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

/* A count travels 2^-31 to 2^20. */
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

/* Keep the last plan if its bytes are the same, because dahl_prepare is slower than the steps. */
static inline const fuzz_plan_t *fuzz_plan(fuzz_bytes_t *bytes, fuzz_plan_t *kept)
{
    dahl_params_t params = fuzz_params(bytes);
    if (memcmp(&params, &kept->params, sizeof params) != 0) {
        kept->params = params;
        kept->good = dahl_prepare(&kept->plan, &params) == DAHL_OK;
    }
    return kept;
}

static inline int fuzz_is_positive(float x)
{
    return x > 0 && isfinite(x);
}

static inline int fuzz_is_in_limits(float x)
{
    return x >= DAHL_TORQUE_MIN && x < DAHL_TORQUE_MAX;
}

static inline int fuzz_do_all(int (*test)(float), const dahl_params_t *p)
{
    return test(p->sigma0) && test(p->Fc) && (p->theta_per_count == 0 || test(p->theta_per_count));
}

/* The products of the travel sigma0 theta / Fc with its limits are exact. */
static inline dahl_err_t fuzz_judge(const dahl_params_t *p)
{
    const long double stretch = (long double)p->sigma0 * (long double)p->theta_per_count, Fc = p->Fc;
    if (!fuzz_do_all(fuzz_is_positive, p)) {
        return DAHL_ERR_PARAM;
    }
    if (!fuzz_do_all(fuzz_is_in_limits, p)) {
        return DAHL_ERR_RANGE;
    }
    if (p->theta_per_count == 0) {
        return DAHL_OK;
    }
    return stretch >= Fc * DAHL_TRAVEL_MIN && stretch < Fc * DAHL_TRAVEL_MAX ? DAHL_OK : DAHL_ERR_RANGE;
}

/* The travel of a move, in presliding lengths. */
static inline long double fuzz_travel(const dahl_params_t *params, long double theta)
{
    return fabsl(theta) * (long double)params->sigma0 / (long double)params->Fc;
}

#endif

/* SPDX-License-Identifier: MIT */
/** Presliding damping: add the change of the torque of an element in a tick, times sigma1/(sigma0 period). */
#include "../arith/scale.h"
#include "../model/check_params.h"
#include "dahl_parts.h"

#define GAIN_MAX_Q16 (UINT32_C(1) << 31) /* 32768 */

static DAHL_COLD int32_t check_positive(float value)
{
    const uint32_t bits = dahl_bits_of(value);
    if (bits == 0 || bits >= DAHL_BITS_INF) {
        return DAHL_ERR_PARAM;
    }
    return dahl_bits_of(DAHL_TORQUE_MIN) <= bits && bits < dahl_bits_of(DAHL_TORQUE_MAX) ? DAHL_OK : DAHL_ERR_RANGE;
}

/** Return sigma1/(sigma0 period) in Q16, at most GAIN_MAX_Q16. */
static DAHL_COLD uint32_t gain_q16(const dahl_params_t *params, float sigma1, float period)
{
    const dahl_real_t real = dahl_real_of(dahl_bits_of(sigma1));
    const dahl_real_t sigma0 = dahl_real_of(dahl_bits_of(params->sigma0)), time = dahl_real_of(dahl_bits_of(period));
    const dahl_wide_t wide = dahl_normalise(dahl_mul(sigma0.mantissa, time.mantissa), sigma0.exponent + time.exponent);
    const uint64_t quotient = dahl_quotient_q63(real.mantissa, (uint32_t)(wide.mantissa >> 32));
    const int32_t shift = -(real.exponent - (wide.exponent + 32) - 63 + 16);
    return shift > 63 ? 0 : shift < 31 || quotient >> shift > GAIN_MAX_Q16 ? GAIN_MAX_Q16 : (uint32_t)(quotient >> shift);
}

DAHL_COLD dahl_err_t dahl_damping_prepare(dahl_damping_plan_t *plan, const dahl_params_t *params, float sigma1, float period)
{
    int32_t err = dahl_check_params(params) | check_positive(sigma1) | check_positive(period);
    if (err == DAHL_OK) {
        const uint32_t gain = gain_q16(params, sigma1, period);
        err = gain == 0 || gain >= GAIN_MAX_Q16 ? DAHL_ERR_RANGE : DAHL_OK;
        plan->gain_q16 = err == DAHL_OK ? (int32_t)gain : plan->gain_q16;
    }
    return (dahl_err_t)err;
}

/** Halve both torques, so that a change from -Fc to Fc fits 32 bits. */
int32_t dahl_damping_apply(const dahl_damping_plan_t *plan, dahl_damping_t *damping, int32_t ratio_q30)
{
    const int32_t half_change = (ratio_q30 >> 1) - (damping->ratio_q30 >> 1);
    const int64_t torque = ratio_q30 + (dahl_mul_signed(half_change, plan->gain_q16) >> 15);
    damping->ratio_q30 = ratio_q30;
    return torque > INT32_MAX ? INT32_MAX : torque < -INT32_MAX ? -INT32_MAX : (int32_t)torque;
}

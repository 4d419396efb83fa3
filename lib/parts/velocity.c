/* SPDX-License-Identifier: MIT */
/** Friction that depends on speed: an odd table over the counts per tick, linear between its values and constant
 * beyond its end. A value is an integer multiple of 2^-30 of the largest one, so interpolation needs one product.
 * Error: half a unit at a value, one and a half between two values, plus the rounding in torque.h. */
#include "../model/torque.h"
#include "dahl_parts.h"

#define SEGMENT_BITS_MAX 24

/** Return DAHL_OK for a valid torque; +-0 is valid. */
static int32_t check_coefficient(uint32_t bits)
{
    uint32_t magnitude = bits & DAHL_BITS_MAGNITUDE;
    if (magnitude >= DAHL_BITS_INF) {
        return DAHL_ERR_PARAM;
    }
    return magnitude == 0 || (dahl_bits_of(DAHL_TORQUE_MIN) <= magnitude && magnitude < dahl_bits_of(DAHL_TORQUE_MAX))
        ? DAHL_OK
        : DAHL_ERR_RANGE;
}

static int32_t ratio_q30(uint32_t bits, dahl_real_t largest)
{
    uint32_t magnitude = bits & DAHL_BITS_MAGNITUDE;
    if (magnitude == 0) {
        return 0;
    }
    dahl_real_t torque = dahl_real_of(magnitude);
    int32_t shift = largest.exponent - torque.exponent + 32;
    uint64_t quotient = dahl_quotient_q63(torque.mantissa, largest.mantissa);
    int32_t ratio = shift > 63 ? 0 : (int32_t)(((quotient >> shift) + 1) >> 1);
    return (bits & DAHL_BITS_SIGN) != 0 ? -ratio : ratio;
}

static void write_velocity_plan(dahl_velocity_plan_t *plan, const dahl_velocity_params_t *params, uint32_t largest)
{
    dahl_real_t scale = largest == 0 ? dahl_real_of(dahl_bits_of(1.0f)) : dahl_real_of(largest);
    plan->segment_bits = params->segment_bits;
    plan->torque_mantissa = scale.mantissa;
    plan->torque_exponent = scale.exponent;
    plan->ratio_q30[0] = 0;
    for (int k = 0; k < DAHL_VELOCITY_SEGMENTS; k++) {
        plan->ratio_q30[k + 1] = ratio_q30(dahl_bits_of(params->torque[k]), scale);
    }
}

dahl_err_t dahl_velocity_prepare(dahl_velocity_plan_t *plan, const dahl_velocity_params_t *params)
{
    int32_t err = params->segment_bits > SEGMENT_BITS_MAX ? DAHL_ERR_RANGE : DAHL_OK;
    uint32_t largest = 0;
    for (int k = 0; k < DAHL_VELOCITY_SEGMENTS; k++) {
        uint32_t bits = dahl_bits_of(params->torque[k]), magnitude = bits & DAHL_BITS_MAGNITUDE;
        err |= check_coefficient(bits);
        largest = magnitude > largest ? magnitude : largest;
    }
    if (err == DAHL_OK) {
        write_velocity_plan(plan, params, largest);
    }
    return (dahl_err_t)err;
}

/** Interpolate between two values of the table. fraction_q32 is the position in the segment. */
static int32_t interpolate(int32_t from, int32_t to, uint32_t fraction_q32)
{
    return to < from ? from - (int32_t)dahl_mulhi((uint32_t)from - (uint32_t)to, fraction_q32)
                     : from + (int32_t)dahl_mulhi((uint32_t)to - (uint32_t)from, fraction_q32);
}

static inline int32_t ratio_at(const dahl_velocity_plan_t *plan, uint32_t counts)
{
    uint32_t segment = counts >> plan->segment_bits;
    if (segment >= DAHL_VELOCITY_SEGMENTS) {
        return plan->ratio_q30[DAHL_VELOCITY_SEGMENTS];
    }
    uint32_t fraction_q32 = counts << 1 << (31 - plan->segment_bits); /* 0 if a segment is one count */
    const int32_t *ends = &plan->ratio_q30[segment];
    return interpolate(ends[0], ends[1], fraction_q32);
}

int32_t dahl_velocity_torque_q30(const dahl_velocity_plan_t *plan, int32_t dcounts)
{
    int32_t ratio = ratio_at(plan, dcounts < 0 ? 0u - (uint32_t)dcounts : (uint32_t)dcounts);
    return dcounts < 0 ? -ratio : ratio;
}

float dahl_velocity_torque(const dahl_velocity_plan_t *plan, int32_t dcounts)
{
    int32_t ratio = ratio_at(plan, dcounts < 0 ? 0u - (uint32_t)dcounts : (uint32_t)dcounts);
    uint32_t sign = (dcounts < 0) != (ratio < 0) ? DAHL_BITS_SIGN : 0, size = (uint32_t)(ratio < 0 ? -ratio : ratio);
    if (size == 0) {
        return 0.0f;
    }
    dahl_real_t scale = {plan->torque_mantissa | 1, plan->torque_exponent};
    uint32_t zeros = dahl_leading_zeros(size);
    return dahl_float_of(sign | dahl_torque_bits(scale, size << zeros, zeros));
}

/* SPDX-License-Identifier: MIT */
/**
 * Load that scales Fc only. The presliding length c Fc/sigma0 changes with the load c, so no table by counts is
 * valid. A tick is by angle, with g(u/c) from the kernel:
 * @verbatim
 *     clamp |F| to c Fc        z = c - s w        w += s z g(u/c)        w = F/Fc, z in Q30
 * @endverbatim
 * If the load falls, F is clamped to c Fc; if it grows, F is kept. Neither increases the energy F^2/(2 sigma0). A z
 * that is rounded up passes the end by at most 2^31, as in ../model/bristle_update.h. A w that Q30 shows as the end
 * is therefore not clamped.
 */
#include "../model/bristle_update.h"
#include "../model/kernel.h"
#include "../model/torque.h"
#include "dahl_parts.h"
#include "reciprocal.h"

#define LOAD_MAX (DAHL_TOP_BIT - 1)

/** Clamp any w to the load. Up to half a unit of Q30 beyond it is allowed, which reads as the load. */
static uint64_t clamp_to_load(uint64_t w, uint32_t load)
{
    const int64_t most = (int64_t)((uint64_t)load << 32 | (DAHL_TOP_BIT - 1));
    if (load == 0) {
        return 0;
    }
    if ((int64_t)w > most) {
        return (uint64_t)load << 32;
    }
    return (int64_t)w < -most - 1 ? 0u - ((uint64_t)load << 32) : w;
}

/** Return |dtheta| a/(c ln 2) for the bits of a normal float and a load that is not 0. If the load is 1, it is the
 * travel of dahl_step(). */
static dahl_scaled_t travel_at_load(const dahl_plan_t *plan, uint32_t magnitude, uint32_t load)
{
    const int32_t a_exponent = dahl_a_exponent(plan);
    if (load == DAHL_ONE_Q30) {
        return dahl_travel(plan->a_mantissa, a_exponent, magnitude);
    }
    dahl_real_t theta = dahl_real_of(magnitude);
    dahl_scaled_t v = dahl_scaled_of(dahl_mul(theta.mantissa, plan->a_mantissa), theta.exponent + a_exponent);
    uint32_t zeros = dahl_leading_zeros(load);
    return dahl_scaled_of(dahl_mul(v.mantissa, dahl_reciprocal_q31(load << zeros)), (int32_t)zeros - v.shift - 65);
}

static uint64_t move_clamped(const dahl_plan_t *plan, uint64_t w, uint32_t bits, uint32_t load)
{
    uint32_t magnitude = bits & DAHL_BITS_MAGNITUDE, backward = bits & DAHL_BITS_SIGN;
    if (magnitude == DAHL_BITS_INF) {
        return backward != 0 ? 0u - ((uint64_t)load << 32) : (uint64_t)load << 32;
    }
    if (magnitude < DAHL_BITS_NORMAL || magnitude > DAHL_BITS_INF || load == 0) {
        return w;
    }
    dahl_scaled_t g = dahl_kernel(travel_at_load(plan, magnitude, load));
    return backward != 0 ? w - dahl_mul_scaled(load + dahl_q30(w), g)
                         : w + dahl_mul_scaled(load - dahl_q30(w), g);
}

float dahl_clamped_step(const dahl_plan_t *plan, dahl_state_t *state, float dtheta, uint32_t load_q30)
{
    uint32_t load = load_q30 < LOAD_MAX ? load_q30 : LOAD_MAX;
    if (plan->a_mantissa == 0) { /* a plan of all zeros */
        return 0.0f;
    }
    uint64_t w = move_clamped(plan, clamp_to_load((uint64_t)state->w, load), dahl_bits_of(dtheta), load);
    state->w = (int64_t)w;
    return dahl_torque_of(plan, w);
}

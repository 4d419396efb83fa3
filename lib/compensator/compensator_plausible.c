/* SPDX-License-Identifier: MIT */
/** Find parameters of a compensator that are probably in a wrong unit. No float operation. */
#include "dahl_compensator.h"
#include "real.h"

#define LONGEST_PERIOD 0.04f /* [s] */

/** A fade lasts for more than one tick, if it is not at once. */
static int is_longer_than_fade(float period, float fade)
{
    return !dahl_is_zero(fade) && dahl_bits_of(period) > dahl_bits_of(fade);
}

/** Return true if the counts of a tick at fade_speed are above jump. */
static int is_fade_a_jump(const dahl_compensator_params_t *params)
{
    if (dahl_is_zero(params->fade_speed)) {
        return 0;
    }
    dahl_real_t move = dahl_real_multiply(dahl_real_of_param(params->fade_speed), dahl_real_of_param(params->period));
    dahl_real_t counts = dahl_real_divide(move, dahl_real_of_param(params->friction.theta_per_count));
    return dahl_real_to_fixed(counts, 0, UINT32_MAX) > params->jump;
}

DAHL_COLD dahl_compensator_plausible_t dahl_compensator_params_plausible(const dahl_compensator_params_t *params)
{
    dahl_compensator_plan_t plan;
    if (dahl_compensator_prepare(&plan, params) != DAHL_COMPENSATOR_OK) {
        return DAHL_COMPENSATOR_PLAUSIBLE;
    }
    if (dahl_bits_of(params->period) > dahl_bits_of(LONGEST_PERIOD) || is_longer_than_fade(params->period, params->rise)
        || is_longer_than_fade(params->period, params->fall)) {
        return DAHL_COMPENSATOR_LONG_PERIOD;
    }
    return is_fade_a_jump(params) ? DAHL_COMPENSATOR_FAST_FADE : DAHL_COMPENSATOR_PLAUSIBLE;
}

/* SPDX-License-Identifier: MIT */
/** Write the parameters of the compensator from the result. */
#include "commission.h"

#define SLEW_PER_FC 100.0f   /* 1/s */
#define SLEW_PER_RING 0.1f   /* of Fc sqrt(sigma0/inertia): a light rotor needs more */
#define JUMP_SPEED 100.0f    /* rad/s */
#define ROUNDING 1e-6f

void dahl_write_params(const dahl_commission_t *axis, dahl_compensator_params_t *params, int has_load)
{
    const dahl_commission_result_t *result = &axis->result;
    const float Fc = result->Fc.least, length = (result->elastic ? 4.0f : 1.0f) * result->length.most;
    const float load = has_load ? result->load_most : 0;
    const float ring = Fc * dahl_root(result->sigma0.most / result->inertia.least);
    *params = (dahl_compensator_params_t){
        .friction = {Fc / length * (1 - ROUNDING), Fc, axis->config.theta_per_count},
        .law = DAHL_COMPENSATOR_MEASURED,
        .Fc_low = Fc,
        .length_long = result->length.most,
        .sigma0_high = result->sigma0.most,
        .load = load,
        .inertia = result->inertia.least,
        .delay = result->delay.most,
        .elastic = result->elastic,
        .gain = dahl_larger(0, dahl_smaller(result->gain, COMMISSION_MAX_GAIN * (1 - load / Fc))),
        .limit = 1.2f * Fc,
        .slew = dahl_larger(SLEW_PER_FC * Fc, SLEW_PER_RING * ring),
        .period = axis->config.period,
        .rise = 0.05f,
        .fall = 0.02f,
        .fade_speed = DAHL_COMMISSION_SPEED_MAX,
        .noise = result->noise,
        .play = result->play,
        .jump = (uint32_t)(JUMP_SPEED * axis->config.period / axis->config.theta_per_count) + 4u * result->play + 1u,
    };
}

dahl_compensator_err_t dahl_commission_params(const dahl_commission_t *axis, dahl_compensator_params_t *params, int has_load)
{
    dahl_compensator_plan_t plan;
    dahl_write_params(axis, params, has_load);
    return dahl_compensator_prepare(&plan, params);
}

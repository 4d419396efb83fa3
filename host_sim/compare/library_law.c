/* SPDX-License-Identifier: MIT */
#include "library_law.h"

#include "../timing.h"

static const float BELOW_ONE = 0.999f; /* keeps length_long below the length that floats give */
static const float SIGMA0_HIGH = 100.0f; /* N m/rad */

/* The bounds are the assumed values. The play is that of the guarantee. */
static dahl_compensator_params_t params_of(const law_params_t *law)
{
    float sigma0 = (float)law->sigma0, Fc = (float)law->Fc;
    return (dahl_compensator_params_t){
        .friction = {sigma0, Fc, (float)law->theta_per_count},
        .law = law->is_hand ? DAHL_COMPENSATOR_MEASURED : DAHL_COMPENSATOR_REFERENCE,
        .Fc_low = Fc,
        .length_long = BELOW_ONE * Fc / sigma0,
        .sigma0_high = SIGMA0_HIGH,
        .inertia = (float)law->inertia,
        .delay = (float)(law->delay * PERIOD_S),
        .gain = law->is_hand ? 0.9f : 1.0f,
        .limit = LIBRARY_LIMIT,
        .slew = LIBRARY_SLEW,
        .period = (float)PERIOD_S,
        .noise = law->noise,
        .play = law->noise == 0 ? 1 : 2 * law->noise + 2,
        .jump = DAHL_COMPENSATOR_JUMP_MAX,
    };
}

int dahl_library_law_open(const law_params_t *law, library_law_t *library)
{
    dahl_compensator_params_t params = params_of(law);
    *library = (library_law_t){.Fc = params.friction.Fc};
    dahl_err_t refusal = dahl_prepare(&library->friction, &params.friction);
    if (refusal != DAHL_OK) {
        return (int)refusal;
    }
    dahl_compensator_err_t code = dahl_compensator_prepare(&library->plan, &params);
    if (code == DAHL_COMPENSATOR_OK && law->law == DAHL_LAW_DAHL_OBSERVER) {
        float limit = params.friction.Fc / (law->has_integral ? 2 : 1);
        dahl_residual_params_t residual = {.inertia = params.inertia, .corner = (float)law->knob, .limit = limit,
                                           .speed_gain = (float)law->speed_gain, .delay = law->delay,
                                           .no_integral = !law->has_integral};
        code = dahl_residual_prepare(&library->residual_plan, &params, &residual);
    }
    return (int)code;
}

double dahl_library_law_torque(const law_params_t *law, library_law_t *library, const reading_t *now)
{
    int32_t move = dahl_compensator_move(&library->plan, &library->compensator, now->dcounts, 1);
    int32_t ratio = dahl_step_counts_q30(&library->friction, &library->bristle, law->is_hand ? move : now->target_move);
    int32_t y = dahl_compensator_torque(&library->plan, &library->compensator, ratio);
    float unit = library->Fc * (float)DAHL_Q30;
    library->known = unit * (float)y;
    if (law->law != DAHL_LAW_DAHL_OBSERVER) {
        return (double)library->known;
    }
    int32_t residual = dahl_residual_torque(&library->residual_plan, &library->residual, &library->compensator, now->dcounts);
    return (double)(library->known + unit * (float)residual);
}

void dahl_library_law_note(library_law_t *library, double command)
{
    float unexplained = (float)command - library->known;
    dahl_residual_note(&library->residual, dahl_residual_q24(&library->residual_plan, unexplained));
}

/* SPDX-License-Identifier: MIT */
/** The Dahl element as a model chosen at run time. */
#include "../arith/compiler.h"
#include "model.h"

static DAHL_COLD dahl_err_t prepare_dahl(void *plan, const dahl_model_params_t *params)
{
    const dahl_params_t one = dahl_element_params(params, 0);
    return dahl_prepare((dahl_plan_t *)plan, &one);
}

static float step_dahl(const void *plan, void *state, int32_t dcounts, uint32_t load_q30)
{
    (void)load_q30;
    return dahl_step_counts((const dahl_plan_t *)plan, (dahl_state_t *)state, dcounts);
}

static int32_t step_dahl_q30(const void *plan, void *state, int32_t dcounts, uint32_t load_q30)
{
    (void)load_q30;
    return dahl_step_counts_q30((const dahl_plan_t *)plan, (dahl_state_t *)state, dcounts);
}

DAHL_DEFINE_MODEL(dahl, dahl_plan_t, dahl_state_t)

/* SPDX-License-Identifier: MIT */
/** Node with slip elements. */
#include "use_model.h"

/** The model is the first member of its storage. */
static dahl_node_slip_t *slip_of(dahl_node_model_t *model)
{
    return (dahl_node_slip_t *)(void *)model;
}

static int32_t step_slip_q30(dahl_node_model_t *model, int32_t dcounts)
{
    return dahl_slip_step_counts_q30(&slip_of(model)->plan, &slip_of(model)->state, dcounts);
}

static void relax_slip(dahl_node_model_t *model)
{
    slip_of(model)->state = (dahl_slip_state_t){{0}};
}

dahl_err_t dahl_node_use_slip(dahl_node_t *node, dahl_node_slip_t *slip, const dahl_slip_params_t *params)
{
    dahl_err_t err = dahl_slip_prepare(&slip->plan, params);
    if (err == DAHL_OK) {
        dahl_params_t sums = {.theta_per_count = params->theta_per_count};
        for (uint32_t k = 0; k < params->elements; k++) {
            sums.sigma0 += params->sigma0[k];
            sums.Fc += params->Fc[k];
        }
        slip->model = (dahl_node_model_t){step_slip_q30, relax_slip, DAHL_FRAMES_MODEL_SLIP + params->elements, 0};
        slip->state = (dahl_slip_state_t){{0}};
        dahl_node_use(node, &slip->model, &sums);
    }
    return err;
}

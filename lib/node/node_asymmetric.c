/* SPDX-License-Identifier: MIT */
/** Node with asymmetric friction. */
#include "use_model.h"

static dahl_node_asymmetric_t *asymmetric_of(dahl_node_model_t *model)
{
    return (dahl_node_asymmetric_t *)(void *)model;
}

static int32_t step_asymmetric_q30(dahl_node_model_t *model, int32_t dcounts)
{
    return dahl_asymmetric_step_counts_q30(&asymmetric_of(model)->plan, &asymmetric_of(model)->state, dcounts);
}

static void relax_asymmetric(dahl_node_model_t *model)
{
    asymmetric_of(model)->state = (dahl_state_t){0};
}

dahl_err_t dahl_node_use_asymmetric(dahl_node_t *node, dahl_node_asymmetric_t *storage, const dahl_asymmetric_params_t *params)
{
    dahl_err_t err = dahl_asymmetric_prepare(&storage->plan, params);
    if (err == DAHL_OK) {
        float larger = params->Fc_forward > params->Fc_backward ? params->Fc_forward : params->Fc_backward;
        const dahl_params_t shown = {params->sigma0, larger, params->theta_per_count};
        storage->model = (dahl_node_model_t){step_asymmetric_q30, relax_asymmetric, DAHL_FRAMES_MODEL_ASYMMETRIC, 0};
        storage->state = (dahl_state_t){0};
        dahl_node_use(node, &storage->model, &shown);
    }
    return err;
}

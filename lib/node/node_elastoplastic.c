/* SPDX-License-Identifier: MIT */
/** Node with elasto-plastic friction. */
#include "use_model.h"

static dahl_node_elastoplastic_t *elastoplastic_of(dahl_node_model_t *model)
{
    return (dahl_node_elastoplastic_t *)(void *)model;
}

static int32_t step_elastoplastic_q30(dahl_node_model_t *model, int32_t dcounts)
{
    return dahl_elastoplastic_step_counts_q30(&elastoplastic_of(model)->plan, &elastoplastic_of(model)->state, dcounts);
}

static void relax_elastoplastic(dahl_node_model_t *model)
{
    elastoplastic_of(model)->state = (dahl_state_t){0};
}

dahl_err_t dahl_node_use_elastoplastic(dahl_node_t *node, dahl_node_elastoplastic_t *storage, const dahl_params_t *params,
                                       float breakaway)
{
    dahl_err_t err = dahl_elastoplastic_prepare(&storage->plan, params, breakaway);
    if (err == DAHL_OK) {
        storage->model = (dahl_node_model_t){step_elastoplastic_q30, relax_elastoplastic, DAHL_FRAMES_MODEL_ELASTOPLASTIC, 0};
        storage->state = (dahl_state_t){0};
        dahl_node_use(node, &storage->model, params);
    }
    return err;
}

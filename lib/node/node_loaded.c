/* SPDX-License-Identifier: MIT */
/** Node with friction that scales with a load. */
#include "use_model.h"

static dahl_node_loaded_t *loaded_of(dahl_node_model_t *model)
{
    return (dahl_node_loaded_t *)(void *)model;
}

static int32_t step_loaded_q30(dahl_node_model_t *model, int32_t dcounts)
{
    return dahl_loaded_step_counts_q30(&loaded_of(model)->plan, &loaded_of(model)->state, dcounts, model->load_q30);
}

static void relax_loaded(dahl_node_model_t *model)
{
    loaded_of(model)->state = (dahl_loaded_state_t){{0}, 0};
}

dahl_err_t dahl_node_use_loaded(dahl_node_t *node, dahl_node_loaded_t *storage, const dahl_params_t *params)
{
    dahl_err_t err = dahl_prepare(&storage->plan, params);
    if (err == DAHL_OK) {
        storage->model = (dahl_node_model_t){step_loaded_q30, relax_loaded, DAHL_FRAMES_MODEL_LOADED, 0};
        storage->state = (dahl_loaded_state_t){{0}, 0};
        dahl_node_use(node, &storage->model, params);
    }
    return err;
}

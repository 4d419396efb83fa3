/* SPDX-License-Identifier: MIT */
/** Node with a model of dahl_parts.h. */
#include "../arith/compiler.h"
#include "model_storage.h"

#include <stddef.h>

/** Plan and state of each storage are where dahl_node_plan() and dahl_node_state() expect them. */
#define CHECK_PLACES(name, ...)                                                                                                \
    typedef char check_places_of_##name                                                                                        \
        [offsetof(dahl_node_##name##_t, state) == sizeof(dahl_node_model_t) + sizeof(dahl_##name##_plan_t) ? 1 : -1];
DAHL_OTHER_MODELS(CHECK_PLACES)

/** Write the parameters as a client reads them: sigma0 and Fc of one element, the sums of several, or the larger Fc of
 * two directions. Not inlined, since its registers would add to the stack of a prepare function. */
static DAHL_COLD DAHL_OUT_OF_LINE void show_params(dahl_node_t *node, const dahl_model_q30_t *model,
                                                   const dahl_model_params_t *params)
{
    const uint32_t count = model->Fcs == 0 ? params->each.elements : model->Fcs;
    dahl_params_t shown = {.theta_per_count = params->each.theta_per_count};
    for (uint32_t k = 0; k < count; k++) {
        const float Fc = params->each.Fc[k];
        if (k == 0 || model->sigma0s == 0) {
            shown.sigma0 += params->each.sigma0[k];
        }
        if (model->Fcs != 2) {
            shown.Fc += Fc;
        } else if (Fc > shown.Fc) {
            shown.Fc = Fc;
        }
    }
    node->params = shown;
    node->held = shown;
}

dahl_err_t dahl_node_use(dahl_node_t *node, dahl_node_model_t *storage, const dahl_model_q30_t *model,
                         const dahl_model_params_t *params)
{
    dahl_err_t err = model->prepare(dahl_node_plan(storage), params);
    if (err == DAHL_OK) {
        storage->calls = model;
        storage->kind = model->number + (model->sigma0s == 0 ? params->each.elements : 0u);
        dahl_node_relax(storage);
        node->model = storage;
        show_params(node, model, params);
    }
    return err;
}

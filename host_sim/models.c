/* SPDX-License-Identifier: MIT */
#include "models.h"

#define MODEL_CALLS(name, NAME, ...) [MODEL_##NAME] = &dahl_model_##name##_q30,
static const dahl_model_q30_t *const calls[] = {DAHL_MODELS(MODEL_CALLS)};

static void copy(float *to, const run_list_t *from)
{
    for (uint32_t k = 0; k < from->count; k++) {
        to[k] = (float)from->value[k];
    }
}

dahl_err_t models_use(dahl_node_t *node, model_memory_t *memory, const run_friction_t *f)
{
    dahl_model_params_t params = {.each = {.elements = f->Fc.count, .theta_per_count = (float)f->theta_per_count},
                                  .slips = f->slips,
                                  .own = (float)f->breakaway};
    if (f->number == MODEL_DAHL) {
        return DAHL_OK; /* as after dahl_node_init() */
    }
    copy(params.each.sigma0, &f->sigma0);
    copy(params.each.Fc, &f->Fc);
    return dahl_node_use(node, &memory->slip.model, calls[f->number], &params);
}

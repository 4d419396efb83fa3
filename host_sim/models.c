/* SPDX-License-Identifier: MIT */
#include "models.h"

static void copy(float *to, const run_list_t *from)
{
    for (uint32_t k = 0; k < from->count; k++) {
        to[k] = (float)from->value[k];
    }
}

static dahl_err_t use_slip(dahl_node_t *node, model_memory_t *memory, const run_friction_t *f)
{
    dahl_slip_params_t params = {.elements = f->Fc.count, .theta_per_count = (float)f->theta_per_count};
    copy(params.sigma0, &f->sigma0);
    copy(params.Fc, &f->Fc);
    return dahl_node_use_slip(node, &memory->slip, &params);
}

static dahl_err_t use_parallel(dahl_node_t *node, model_memory_t *memory, const run_friction_t *f)
{
    dahl_node_parallel_params_t params = {
        .elements = f->Fc.count, .slips = f->slips, .theta_per_count = (float)f->theta_per_count};
    copy(params.sigma0, &f->sigma0);
    copy(params.Fc, &f->Fc);
    return dahl_node_use_parallel(node, &memory->parallel, &params);
}

/* Each model with one Fc for each direction. */
#define USE_DIRECTED(name, ...)                                                                                                \
    static dahl_err_t use_##name(dahl_node_t *node, model_memory_t *memory, const run_friction_t *f)                         \
    {                                                                                                                          \
        const dahl_##name##_params_t params = {.sigma0 = (float)f->sigma0.value[0],                                         \
                                               .Fc_forward = (float)f->Fc.value[0],                                         \
                                               .Fc_backward = (float)f->Fc.value[1],                                        \
                                               .theta_per_count = (float)f->theta_per_count};                                  \
        return dahl_node_use_##name(node, &memory->name, &params);                                                             \
    }
DAHL_FRAMES_DIRECTED_MODELS(USE_DIRECTED)

static dahl_err_t use_elastoplastic(dahl_node_t *node, model_memory_t *memory, const run_friction_t *f)
{
    const dahl_params_t params = {(float)f->total_sigma0, (float)f->total_Fc, (float)f->theta_per_count};
    return dahl_node_use_elastoplastic(node, &memory->elastoplastic, &params, (float)f->breakaway);
}

static dahl_err_t use_loaded(dahl_node_t *node, model_memory_t *memory, const run_friction_t *f)
{
    const dahl_params_t params = {(float)f->total_sigma0, (float)f->total_Fc, (float)f->theta_per_count};
    return dahl_node_use_loaded(node, &memory->loaded, &params);
}

#define USE_MODEL(name, NAME, ...)                                                                                             \
    case MODEL_##NAME: return use_##name(node, memory, friction);

dahl_err_t models_use(dahl_node_t *node, model_memory_t *memory, const run_friction_t *friction)
{
    switch (friction->number) {
        DAHL_FRAMES_OTHER_MODELS(USE_MODEL)
    default: return DAHL_OK;
    }
}

/* SPDX-License-Identifier: MIT */
#include "models.h"

#include "stderr_messages.h"

#define MODEL_CALLS(name, NAME, ...) [MODEL_##NAME] = &dahl_model_##name##_q30,
static const dahl_model_q30_t *const calls[] = {DAHL_MODELS(MODEL_CALLS)};

static void copy(float *to, const run_list_t *from)
{
    for (uint32_t k = 0; k < from->count; k++) {
        to[k] = (float)from->value[k];
    }
}

static dahl_err_t start(dahl_node_t *node, model_memory_t *memory, const run_friction_t *f, uint8_t number)
{
    dahl_model_params_t params = {.each = {.elements = f->Fc.count, .theta_per_count = (float)f->theta_per_count},
                                  .slips = f->slips,
                                  .own = (float)f->own};
    copy(params.each.sigma0, &f->sigma0);
    copy(params.each.Fc, &f->Fc);
    const dahl_params_t first = {params.each.sigma0[0], params.each.Fc[0], params.each.theta_per_count};
    dahl_err_t err = dahl_node_init(node, &first, number);
    return err != DAHL_OK || f->number == MODEL_DAHL ? err : dahl_node_use(node, &memory->slip.model, calls[f->number], &params);
}

/* The table of keys has the other limits. */
static void report(dahl_err_t err, const run_friction_t *f, const char *path)
{
    for (uint32_t k = 0; k < f->Fc.count; k++) {
        double sigma0 = f->sigma0.value[f->sigma0.count == 1 ? 0 : k], travel = sigma0 / f->Fc.value[k] * f->theta_per_count;
        if (travel < DAHL_TRAVEL_MIN || travel >= DAHL_TRAVEL_MAX) {
            log_error("%s: friction.theta_per_count = %.9g: one count travels %.9g Fc/sigma0 of element %u: outside 2^-30 to 2^20",
                      path, f->theta_per_count, travel, k + 1);
            return;
        }
    }
    log_error("%s: friction: the library refuses these parameters (dahl_err_t %d)", path, (int)err);
}

int models_start(dahl_node_t *node, model_memory_t *memory, const run_friction_t *f, uint8_t number, const char *path)
{
    dahl_err_t err = start(node, memory, f, number);
    if (err != DAHL_OK) {
        report(err, f, path);
        return -1;
    }
    return 0;
}

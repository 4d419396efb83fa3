/* SPDX-License-Identifier: MIT */
/* friction: see friction.h. */
#include "friction.h"

#include <math.h>
#include <string.h>

#define ONE_Q30 1073741824.0
#define FINE_TRAVEL 0x1p-20f /* [1] of a count, in presliding lengths */

static dahl_params_t first_element(const friction_t *f)
{
    return (dahl_params_t){f->params.sigma0[0], f->params.Fc[0], f->params.theta_per_count};
}

static dahl_err_t use_dahl(friction_t *f)
{
    const dahl_params_t params = first_element(f);
    return dahl_node_init(&f->node, &params, 0);
}

static dahl_err_t use_slip(friction_t *f)
{
    return dahl_node_use_slip(&f->node, &f->storage.slip, &f->params);
}

static dahl_err_t use_parallel(friction_t *f)
{
    dahl_node_parallel_params_t params = {f->params.elements, f->slips, f->params.theta_per_count, {0}, {0}};
    memcpy(params.sigma0, f->params.sigma0, sizeof params.sigma0);
    memcpy(params.Fc, f->params.Fc, sizeof params.Fc);
    return dahl_node_use_parallel(&f->node, &f->storage.parallel, &params);
}

static dahl_err_t use_elastoplastic(friction_t *f)
{
    const dahl_params_t params = first_element(f);
    return dahl_node_use_elastoplastic(&f->node, &f->storage.elastoplastic, &params, f->breakaway);
}

static dahl_err_t use_loaded(friction_t *f)
{
    const dahl_params_t params = first_element(f);
    return dahl_node_use_loaded(&f->node, &f->storage.loaded, &params);
}

/* Each model with one Fc for each direction. */
#define USE_DIRECTED(name, ...)                                                                                                \
    static dahl_err_t use_##name(friction_t *f)                                                                                \
    {                                                                                                                          \
        const float *Fc = f->params.Fc;                                                                                        \
        const dahl_##name##_params_t params = {f->params.sigma0[0], Fc[0], Fc[1], f->params.theta_per_count};                  \
        return dahl_node_use_##name(&f->node, &f->storage.name, &params);                                                      \
    }
DAHL_FRAMES_DIRECTED_MODELS(USE_DIRECTED)

#define STATE(member) offsetof(friction_t, member), sizeof((friction_t *)0)->member
#define MODEL(name, NAME, Class, number, sigma0s, Fcs, plan, key, meaning)                                                     \
    {#name, sigma0s, Fcs, use_##name, STATE(storage.name.state)},
static const friction_model_t models[] = {{"dahl", 1, 1, use_dahl, STATE(node.bearing)}, DAHL_FRAMES_OTHER_MODELS(MODEL)};

const friction_model_t *friction_find(const char *name)
{
    for (size_t i = 0; i < sizeof models / sizeof models[0]; i++) {
        if (strcmp(models[i].name, name) == 0) {
            return &models[i];
        }
    }
    return NULL;
}

static float fine_count(const friction_t *f)
{
    float least = INFINITY;
    for (uint32_t k = 0; k < f->params.elements; k++) {
        least = fminf(least, f->params.Fc[k] / f->params.sigma0[k < f->sigma0s ? k : 0]);
    }
    return FINE_TRAVEL * least;
}

dahl_err_t friction_prepare(friction_t *f)
{
    if (f->model->use != use_dahl && !(f->params.theta_per_count > 0.0f)) {
        f->params.theta_per_count = fine_count(f);
    }
    f->Fc = 0.0;
    for (uint32_t k = 0; k < f->params.elements; k++) {
        const double Fc = (double)f->params.Fc[k];
        f->Fc = f->model->Fcs == 2 ? fmax(f->Fc, Fc) : f->Fc + Fc;
    }
    return f->model->use(f);
}

double friction_position(const friction_t *f, double angle)
{
    const double theta = (double)f->params.theta_per_count;
    return theta > 0.0 ? rint(angle / theta) : angle;
}

double friction_move(friction_t *f, double move, double load)
{
    const double counts = fmax(fmin(move, INT32_MAX), INT32_MIN), load_q30 = rint(fmax(fmin(load, 1.0), 0.0) * ONE_Q30);
    if (f->node.model != NULL) {
        f->node.model->load_q30 = (uint32_t)load_q30;
        return f->node.model->step_q30(f->node.model, (int32_t)counts) / ONE_Q30 * f->Fc;
    }
    if (f->params.theta_per_count > 0.0f) {
        return (double)dahl_step_counts(&f->node.plan, &f->node.bearing, (int32_t)counts);
    }
    return (double)dahl_step(&f->node.plan, &f->node.bearing, (float)move);
}

/* Return word k of the state, or NULL after the last. The slip elements of parallel follow its Dahl elements. */
static void *state_word(friction_t *f, int k)
{
    const size_t at = (size_t)k * sizeof(uint32_t), size = f->model->state_size;
    if (at < size) {
        return (char *)f + f->model->state + at;
    }
    if (f->model->use == use_parallel && at - size < sizeof f->storage.parallel.slip_state) {
        return (char *)&f->storage.parallel.slip_state + (at - size);
    }
    return NULL;
}

int friction_words(friction_t *f)
{
    int count = 0;
    while (state_word(f, count) != NULL) {
        count++;
    }
    return count;
}

void friction_save(friction_t *f, double *words)
{
    void *word;
    for (int k = 0; (word = state_word(f, k)) != NULL; k++) {
        uint32_t bits;
        memcpy(&bits, word, sizeof bits);
        words[k] = bits;
    }
}

void friction_restore(friction_t *f, const double *words)
{
    void *word;
    for (int k = 0; (word = state_word(f, k)) != NULL; k++) {
        const uint32_t bits = words[k] >= 0.0 && words[k] <= UINT32_MAX ? (uint32_t)words[k] : 0;
        memcpy(word, &bits, sizeof bits);
    }
}

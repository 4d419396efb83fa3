/* SPDX-License-Identifier: MIT */
/* friction: see friction.h. */
#include "friction.h"

#include <string.h>

#define TWO_30 0x1p30        /* of a ratio in Q30 */
#define FINE_TRAVEL 0x1p-20f /* [presliding lengths] of one count */
#define MOVE_MAX 0x1p36      /* 64 presliding lengths or more: every element is at its end */
#define TWO_52 0x1p52        /* a double from here on is an integer */

#define ROW(name, NAME, Class, number, sigma0s, Fcs, ...) {#name, sigma0s, Fcs},
const friction_model_t friction_models[FRICTION_MODELS] = {DAHL_FRAMES_MODELS(ROW)};

uint32_t friction_find(const char *name)
{
    uint32_t model = 0;
    while (model < FRICTION_MODELS && strcmp(friction_models[model].name, name) != 0) {
        model++;
    }
    return model;
}

uint32_t friction_count_states(const friction_t *f)
{
    return f->model == FRICTION_PARALLEL ? f->params.elements : 1;
}

static bool is_slip_part(const friction_t *f, uint32_t k)
{
    return (f->slips >> k & 1u) != 0;
}

static void join_parts(const friction_t *f, friction_state_t *state, dahl_part_t *parts)
{
    for (uint32_t k = 0; k < f->params.elements; k++) {
        const dahl_part_t dahl = DAHL_PART(&f->plan[k].dahl, &state[k].bristle.bristle);
        const dahl_part_t slip = DAHL_SLIP_PART(&f->plan[k].slip, &state[k].slip);
        parts[k] = is_slip_part(f, k) ? slip : dahl;
    }
}

static dahl_err_t prepare_parallel(friction_t *f)
{
    friction_state_t unread[DAHL_SLIP_MAX];
    dahl_part_t parts[DAHL_SLIP_MAX];
    for (uint32_t k = 0; k < f->params.elements; k++) {
        const float sigma0 = f->params.sigma0[k], Fc = f->params.Fc[k], theta = f->params.theta_per_count;
        const dahl_params_t dahl = {sigma0, Fc, theta};
        const dahl_slip_params_t slip = {1, theta, {sigma0}, {Fc}};
        friction_plan_t *plan = &f->plan[k];
        const dahl_err_t err = is_slip_part(f, k) ? dahl_slip_prepare(&plan->slip, &slip) : dahl_prepare(&plan->dahl, &dahl);
        if (err != DAHL_OK) {
            return err;
        }
    }
    join_parts(f, unread, parts);
    dahl_parallel_shares(f->share, parts, f->params.elements);
    return DAHL_OK;
}

#define PREPARE_DIRECTED(name, NAME, ...)                                                                                      \
    case FRICTION_##NAME: {                                                                                                    \
        const dahl_##name##_params_t directed = {one.sigma0, one.Fc, f->params.Fc[1], one.theta_per_count};                    \
        return dahl_##name##_prepare(&f->plan->name, &directed);                                                               \
    }

static dahl_err_t prepare_plan(friction_t *f)
{
    const dahl_params_t one = {f->params.sigma0[0], f->params.Fc[0], f->params.theta_per_count};
    switch (f->model) {
    case FRICTION_DAHL:
    case FRICTION_LOADED: return dahl_prepare(&f->plan->dahl, &one);
    case FRICTION_SLIP: return dahl_slip_prepare(&f->plan->slip, &f->params);
    case FRICTION_PARALLEL: return prepare_parallel(f);
    case FRICTION_ELASTOPLASTIC: return dahl_elastoplastic_prepare(&f->plan->elastoplastic, &one, f->breakaway);
    DAHL_FRAMES_DIRECTED_MODELS(PREPARE_DIRECTED)
    default: return DAHL_ERR_PARAM;
    }
}

static float fine_count(const friction_t *f)
{
    const bool has_one_sigma0 = friction_models[f->model].sigma0s == 1;
    float least = f->params.Fc[0] / f->params.sigma0[0];
    for (uint32_t k = 1; k < f->params.elements; k++) {
        const float length = f->params.Fc[k] / f->params.sigma0[has_one_sigma0 ? 0 : k];
        least = length < least ? length : least;
    }
    return FINE_TRAVEL * least;
}

static double full_torque(const friction_t *f)
{
    const double first = (double)f->params.Fc[0], second = (double)f->params.Fc[1];
    if (friction_models[f->model].Fcs == 2) {
        return first > second ? first : second;
    }
    double sum = 0.0;
    for (uint32_t k = 0; k < f->params.elements; k++) {
        sum += (double)f->params.Fc[k];
    }
    return sum;
}

dahl_err_t friction_prepare(friction_t *f)
{
    if (f->model >= FRICTION_MODELS) {
        return DAHL_ERR_PARAM;
    }
    if (f->model != FRICTION_DAHL && !f->is_stiffness_fixed && !(f->params.theta_per_count > 0.0f)) {
        f->params.theta_per_count = fine_count(f);
    }
    f->Fc = full_torque(f);
    return prepare_plan(f);
}

/* Round to the nearest integer, a half to the even one, as rint() does. An FMU is not linked with libm. */
static double nearest(double x)
{
    const double shift = x < 0.0 ? -TWO_52 : TWO_52;
    return x < TWO_52 && x > -TWO_52 ? (x + shift) - shift : x;
}

double friction_position(const friction_t *f, double angle)
{
    const double theta = (double)f->params.theta_per_count;
    return theta > 0.0 ? nearest(angle / theta) : angle;
}

#define STEP_DIRECTED(name, NAME, ...)                                                                                         \
    case FRICTION_##NAME: return dahl_##name##_step_counts(&f->plan->name, bristle, dcounts);

static float step_counts(const friction_t *f, friction_state_t *state, int32_t dcounts, uint32_t load_q30)
{
    dahl_part_t parts[DAHL_SLIP_MAX];
    dahl_state_t *bristle = &state->bristle.bristle;
    switch (f->model) {
    case FRICTION_SLIP: return dahl_slip_step_counts(&f->plan->slip, &state->slip, dcounts);
    case FRICTION_PARALLEL:
        join_parts(f, state, parts);
        return dahl_parallel_step_counts(parts, f->params.elements, dcounts);
    case FRICTION_ELASTOPLASTIC: return dahl_elastoplastic_step_counts(&f->plan->elastoplastic, bristle, dcounts);
    case FRICTION_LOADED: return dahl_loaded_step_counts(&f->plan->dahl, &state->bristle, dcounts, load_q30);
    DAHL_FRAMES_DIRECTED_MODELS(STEP_DIRECTED)
    default: return dahl_step_counts(&f->plan->dahl, bristle, dcounts);
    }
}

#define STEP_DIRECTED_Q30(name, NAME, ...)                                                                                     \
    case FRICTION_##NAME: return dahl_##name##_step_counts_q30(&f->plan->name, bristle, dcounts);

static int32_t step_counts_q30(const friction_t *f, friction_state_t *state, int32_t dcounts, uint32_t load_q30)
{
    dahl_part_t parts[DAHL_SLIP_MAX];
    dahl_state_t *bristle = &state->bristle.bristle;
    switch (f->model) {
    case FRICTION_SLIP: return dahl_slip_step_counts_q30(&f->plan->slip, &state->slip, dcounts);
    case FRICTION_PARALLEL:
        join_parts(f, state, parts);
        return dahl_parallel_step_counts_q30(parts, f->share, f->params.elements, dcounts);
    case FRICTION_ELASTOPLASTIC: return dahl_elastoplastic_step_counts_q30(&f->plan->elastoplastic, bristle, dcounts);
    case FRICTION_LOADED: return dahl_loaded_step_counts_q30(&f->plan->dahl, &state->bristle, dcounts, load_q30);
    DAHL_FRAMES_DIRECTED_MODELS(STEP_DIRECTED_Q30)
    default: return dahl_step_counts_q30(&f->plan->dahl, bristle, dcounts);
    }
}

/* NaN becomes -limit. */
static double clamp_to(double x, double limit)
{
    return x > limit ? limit : x > -limit ? x : -limit;
}

/* Move by the counts that an int32_t cannot hold, and return the remaining counts. */
static int32_t move_excess(const friction_t *f, friction_state_t *state, double counts, uint32_t load_q30)
{
    double left = clamp_to(counts, MOVE_MAX);
    while (left > INT32_MAX || left < -INT32_MAX) {
        const double part = clamp_to(left, INT32_MAX);
        (void)step_counts(f, state, (int32_t)part, load_q30);
        left -= part;
    }
    return (int32_t)left;
}

float friction_move(const friction_t *f, friction_state_t *state, double distance, double load)
{
    const double load_q30 = nearest(load * TWO_30);
    if (f->is_stiffness_fixed) {
        return dahl_clamped_step(&f->plan->dahl, &state->bristle.bristle, (float)distance, (uint32_t)load_q30);
    }
    if (f->params.theta_per_count > 0.0f) {
        return step_counts(f, state, move_excess(f, state, distance, (uint32_t)load_q30), (uint32_t)load_q30);
    }
    return dahl_step(&f->plan->dahl, &state->bristle.bristle, (float)distance);
}

int32_t friction_move_q30(const friction_t *f, friction_state_t *state, double counts, double load)
{
    const double load_q30 = nearest(load * TWO_30);
    return step_counts_q30(f, state, move_excess(f, state, counts, (uint32_t)load_q30), (uint32_t)load_q30);
}

/* SPDX-License-Identifier: MIT */
/* element: see element.h. */
#include "element.h"

#include <math.h>
#include <string.h>

#define ONE_Q30 (UINT32_C(1) << 30)
#define COUNTS_MAX 0x1p36 /* 64 presliding lengths or more: every element is at its end */

#define FMU_MODEL(name, NAME, ...) FMU_##NAME,
enum { DAHL_FRAMES_MODELS(FMU_MODEL) FMU_MODELS };

#define FMU_NAME(name, ...) #name,
static const char *const names[] = {DAHL_FRAMES_MODELS(FMU_NAME)};

static bool is_slip(const fmu_start_t *start, uint32_t k)
{
    return (start->slips >> k & 1u) != 0;
}

static dahl_err_t prepare_slip(dahl_slip_plan_t *plan, const double *value, uint32_t first, uint32_t elements)
{
    dahl_slip_params_t params = {.elements = elements, .theta_per_count = (float)value[FMU_THETA]};
    for (uint32_t k = 0; k < elements; k++) {
        params.sigma0[k] = (float)value[FMU_SIGMA0 + first + k];
        params.Fc[k] = (float)value[FMU_FC + first + k];
    }
    return dahl_slip_prepare(plan, &params);
}

/* Each part has a plan of its own. */
static dahl_err_t prepare_parallel(fmu_element_t *e, const double *value)
{
    dahl_err_t err = DAHL_OK;
    for (uint32_t k = 0; k < e->start->Fcs && err == DAHL_OK; k++) {
        const dahl_params_t params = {(float)value[FMU_SIGMA0 + k], (float)value[FMU_FC + k], (float)value[FMU_THETA]};
        err = is_slip(e->start, k) ? prepare_slip(&e->slip[k], value, k, 1) : dahl_prepare(&e->plan.dahl[k], &params);
    }
    return err;
}

#define PREPARE_DIRECTED(name, NAME, ...)                                                                                      \
    case FMU_##NAME: {                                                                                                         \
        const dahl_##name##_params_t directed = {one.sigma0, one.Fc, (float)value[FMU_FC + 1], one.theta_per_count};           \
        return dahl_##name##_prepare(&e->plan.name, &directed);                                                                \
    }

static dahl_err_t prepare_model(fmu_element_t *e, const double *value)
{
    const dahl_params_t one = {(float)value[FMU_SIGMA0], (float)value[FMU_FC], (float)value[FMU_THETA]};
    switch (e->model) {
    case FMU_DAHL:
    case FMU_LOADED: return dahl_prepare(e->plan.dahl, &one);
    case FMU_SLIP: return prepare_slip(e->slip, value, 0, e->start->Fcs);
    case FMU_PARALLEL: return prepare_parallel(e, value);
    case FMU_ELASTOPLASTIC: return dahl_elastoplastic_prepare(&e->plan.elastoplastic, &one, (float)value[FMU_BREAKAWAY]);
    DAHL_FRAMES_DIRECTED_MODELS(PREPARE_DIRECTED)
    default: return DAHL_ERR_PARAM;
    }
}

dahl_err_t fmu_prepare(fmu_element_t *element, const fmu_start_t *start, const double *value)
{
    *element = (fmu_element_t){.start = start};
    while (element->model < FMU_MODELS && strcmp(names[element->model], start->model) != 0) {
        element->model++;
    }
    dahl_err_t err = prepare_model(element, value);
    if (err == DAHL_OK) {
        fmu_state_t scratch = {0};
        float forward = fmu_move(element, &scratch, (double)INFINITY, value[FMU_THETA], ONE_Q30);
        float backward = fmu_move(element, &scratch, (double)-INFINITY, value[FMU_THETA], ONE_Q30);
        element->largest_torque = (double)(forward > -backward ? forward : -backward);
    }
    return err;
}

static float step_parallel(const fmu_element_t *e, fmu_state_t *s, int32_t dcounts)
{
    dahl_part_t parts[DAHL_SLIP_MAX];
    for (uint32_t k = 0; k < e->start->Fcs; k++) {
        const dahl_part_t dahl = DAHL_PART(&e->plan.dahl[k], &s->bristle[k].bristle);
        const dahl_part_t slip = DAHL_SLIP_PART(&e->slip[k], &s->slip[k]);
        parts[k] = is_slip(e->start, k) ? slip : dahl;
    }
    return dahl_parallel_step_counts(parts, e->start->Fcs, dcounts);
}

#define STEP_DIRECTED(name, NAME, ...)                                                                                         \
    case FMU_##NAME: return dahl_##name##_step_counts(&e->plan.name, bristle, dcounts);

static float step_counts(const fmu_element_t *e, fmu_state_t *s, int32_t dcounts, uint32_t load_q30)
{
    dahl_state_t *bristle = &s->bristle[0].bristle;
    switch (e->model) {
    case FMU_SLIP: return dahl_slip_step_counts(e->slip, s->slip, dcounts);
    case FMU_PARALLEL: return step_parallel(e, s, dcounts);
    case FMU_ELASTOPLASTIC: return dahl_elastoplastic_step_counts(&e->plan.elastoplastic, bristle, dcounts);
    case FMU_LOADED: return dahl_loaded_step_counts(e->plan.dahl, s->bristle, dcounts, load_q30);
    DAHL_FRAMES_DIRECTED_MODELS(STEP_DIRECTED)
    default: return dahl_step_counts(e->plan.dahl, bristle, dcounts);
    }
}

static double clamp(double x, double limit)
{
    return x > limit ? limit : x > -limit ? x : -limit;
}

static float move_counts(const fmu_element_t *e, fmu_state_t *s, double counts, uint32_t load_q30)
{
    double left = clamp(counts, COUNTS_MAX);
    while (left > INT32_MAX || left < -INT32_MAX) {
        const double part = clamp(left, INT32_MAX);
        (void)step_counts(e, s, (int32_t)part, load_q30);
        left -= part;
    }
    return step_counts(e, s, (int32_t)left, load_q30);
}

float fmu_move(const fmu_element_t *element, fmu_state_t *state, double distance, double theta_per_count, uint32_t load_q30)
{
    const dahl_plan_t *plan = element->plan.dahl;
    if (element->start->fixed_stiffness != 0) {
        return dahl_clamped_step(plan, &state->bristle[0].bristle, (float)distance, load_q30);
    }
    if (theta_per_count > 0) {
        return move_counts(element, state, distance, load_q30);
    }
    return dahl_step(plan, &state->bristle[0].bristle, (float)distance);
}

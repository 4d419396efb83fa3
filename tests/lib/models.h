/* SPDX-License-Identifier: MIT */
/* The table of all friction models: prepare, step and exact torque of each. Tests of the common contract loop over it, so a new
 * model is a new row. step_q30 is NULL if the model has no Q30 form. */
#ifndef MODELS_H
#define MODELS_H

#include <string.h>

#include "dahl_parts.h"
#include "motions.h"
#include "reference.h"

#define ONE_Q30 ((uint32_t)1 << 30)
#define LOAD_MOST 0x7fffffffu

/* The meaning of set_t.more for a model. */
typedef enum { MORE_IS_UNUSED, MORE_IS_ELEMENTS, MORE_IS_RATIO, MORE_IS_BREAKAWAY } more_t;

/* Parameters of one element, and one number more: slip elements, Fc backward over forward, or breakaway. */
typedef struct {
    dahl_params_t p;
    float more;
} set_t;

typedef struct {
    int32_t counts;
    uint32_t load_q30;
} move_t;

typedef dahl_any_plan_t any_plan_t;
typedef dahl_any_state_t any_state_t;

/* Slip elements: the deflections in counts, which end at Fc/(sigma0 theta). */
typedef struct {
    dahl_slip_params_t params;
    long double deflection[DAHL_SLIP_MAX];
} slip_reference_t;

/* The exact solution of a model along a motion. */
typedef struct {
    const set_t *set;
    reference_t curve;
    slip_reference_t slip;
    uint32_t load;
} exact_t;

/* A move of one bristle, in units of Fc and of Fc/sigma0; w is the state before and after it. */
typedef struct {
    const set_t *set;
    int direction;
    long double travel, load, w0, w1;
} stroke_t;

typedef struct {
    const char *name;
    dahl_err_t (*prepare)(any_plan_t *plan, const set_t *set);
    float (*step)(const any_plan_t *plan, any_state_t *state, const set_t *set, move_t move);
    int32_t (*step_q30)(const any_plan_t *plan, any_state_t *state, move_t move);
    long double (*exact)(exact_t *exact, move_t move); /* as a fraction of whole_of() */
    /* work minus the change of the stored energy, in units of Fc^2/sigma0; NULL: the state is not rounded */
    long double (*loss)(const stroke_t *stroke);
    double ulps, q30_error; /* bounds of the header, relative to whole_of() */
    int by_angle;           /* the move is counts times theta_per_count, as a float */
    int is_split;           /* opposite and split travel have the same bits */
    int has_load;           /* 1: the error is relative to c Fc; 2: to the larger of Fc and c Fc */
    more_t more;
} model_t;

/* Parameters of a model of one element: its two Fc, for each direction, and its own key. Other models read fewer. */
static inline dahl_model_params_t element_params(const set_t *set)
{
    const dahl_params_t p = set->p;
    const dahl_model_params_t params = {{1, p.theta_per_count, {p.sigma0}, {p.Fc, p.Fc * set->more}}, 0, set->more};
    return params;
}

/* Define WORD_prepare, WORD_step and WORD_q30 of dahl_model_NAME, whose parameters the function `params_of` returns. */
#define MODEL_CALLS(word, name, params_of)                                                                                        \
    static inline dahl_err_t word##_prepare(any_plan_t *plan, const set_t *set)                                                   \
    {                                                                                                                             \
        const dahl_model_params_t params = params_of(set);                                                                        \
        return dahl_model_##name.q30->prepare(plan, &params);                                                                     \
    }                                                                                                                             \
    static inline float word##_step(const any_plan_t *plan, any_state_t *state, const set_t *set, move_t move)                    \
    {                                                                                                                             \
        (void)set;                                                                                                                \
        return dahl_model_##name.step(plan, state, move.counts, move.load_q30);                                                   \
    }                                                                                                                             \
    static inline int32_t word##_q30(const any_plan_t *plan, any_state_t *state, move_t move)                                     \
    {                                                                                                                             \
        return dahl_model_##name.q30->step_q30(plan, state, move.counts, move.load_q30);                                          \
    }

/* --- Dahl's element, by counts and by angle ----------------------------------------------------------------------- */

MODEL_CALLS(dahl_model, dahl, element_params)

static inline dahl_err_t angle_prepare(any_plan_t *plan, const set_t *set)
{
    const dahl_params_t p = {set->p.sigma0, set->p.Fc, 0.0f}; /* dahl_prepare refuses the travel if a count is too fine */
    return dahl_prepare(&plan->dahl, &p);
}

static inline float angle_of(const set_t *set, move_t move)
{
    volatile float counts = (float)move.counts; /* rounded to float under every compiler flag */
    return counts * set->p.theta_per_count;
}

static inline float angle_step(const any_plan_t *plan, any_state_t *state, const set_t *set, move_t move)
{
    return dahl_step(&plan->dahl, &state->dahl, angle_of(set, move));
}

static inline long double counts_exact(exact_t *exact, move_t move)
{
    return reference_move(&exact->curve, move.counts);
}

static inline long double angle_exact(exact_t *exact, move_t move)
{
    return reference_move(&exact->curve, (long double)angle_of(exact->set, move));
}

static inline long double rise_of(const stroke_t *x)
{
    return x->direction * (x->w1 - x->w0);
}

static inline long double stored_by(const stroke_t *x)
{
    return (x->w1 - x->w0) * (x->w1 + x->w0) / 2;
}

/* In one direction Eq. 1 is F dtheta = end (|dtheta| - s dF), as dahl_work sums it. */
static inline long double dahl_loss(const stroke_t *x)
{
    return x->travel - rise_of(x) - stored_by(x);
}

/* --- slip elements, and a mix of them with a Dahl element ---------------------------------------------------------- */

/* `more` elements with different shares, whose travels to slip spread over three decades. */
static inline dahl_slip_params_t slip_params(const set_t *set)
{
    dahl_slip_params_t params = {(uint32_t)set->more, set->p.theta_per_count, {0}, {0}};
    for (uint32_t k = 0; k < params.elements && k < DAHL_SLIP_MAX; k++) {
        params.Fc[k] = set->p.Fc / (float)(k % 3 + 1);
        params.sigma0[k] = set->p.sigma0 / (float)(k % 3 + 1) * (float)pow(10.0, 3.0 * k / (double)set->more);
    }
    return params;
}

static inline dahl_model_params_t elements_params(const set_t *set)
{
    const dahl_model_params_t params = {slip_params(set), 0, 0};
    return params;
}

MODEL_CALLS(slip, slip, elements_params)

static inline slip_reference_t slip_reference(const dahl_slip_params_t *params)
{
    return (slip_reference_t){*params, {0}};
}

static inline long double slip_reference_Fc(const dahl_slip_params_t *params)
{
    long double sum = 0;
    for (uint32_t k = 0; k < params->elements; k++) {
        sum += params->Fc[k];
    }
    return sum;
}

static inline long double slip_reference_move(slip_reference_t *slip, int32_t counts)
{
    long double F = 0;
    for (uint32_t k = 0; k < slip->params.elements; k++) {
        const long double stiffness = (long double)slip->params.sigma0[k] * slip->params.theta_per_count;
        const long double longest = slip->params.Fc[k] / stiffness, moved = slip->deflection[k] + counts;
        slip->deflection[k] = fmaxl(-longest, fminl(longest, moved));
        F += stiffness * slip->deflection[k];
    }
    return F;
}

static inline long double slip_exact(exact_t *exact, move_t move)
{
    return slip_reference_move(&exact->slip, move.counts) / slip_reference_Fc(&exact->slip.params);
}

static inline dahl_err_t mix_prepare(any_plan_t *plan, const set_t *set)
{
    const dahl_slip_params_t params = slip_params(set);
    dahl_err_t slip = dahl_slip_prepare(&plan->parallel.slip, &params), dahl = dahl_prepare(&plan->parallel.plan[0], &set->p);
    return slip != DAHL_OK ? slip : dahl;
}

static inline float mix_step(const any_plan_t *plan, any_state_t *state, const set_t *set, move_t move)
{
    const dahl_part_t parts[] = {DAHL_PART(&plan->parallel.plan[0], &state->parallel.state[0]), DAHL_SLIP_PART(&plan->parallel.slip, &state->parallel.slip)};
    (void)set;
    return dahl_parallel_step_counts(parts, 2, move.counts);
}

static inline int32_t mix_q30(const any_plan_t *plan, any_state_t *state, move_t move)
{
    const dahl_part_t parts[] = {DAHL_PART(&plan->parallel.plan[0], &state->parallel.state[0]), DAHL_SLIP_PART(&plan->parallel.slip, &state->parallel.slip)};
    int32_t shares[2];
    dahl_parallel_shares(shares, parts, 2);
    return dahl_parallel_step_counts_q30(parts, shares, 2, move.counts);
}

static inline long double mix_exact(exact_t *exact, move_t move)
{
    long double Fc = exact->set->p.Fc, sum = Fc + slip_reference_Fc(&exact->slip.params);
    return (counts_exact(exact, move) * Fc + slip_reference_move(&exact->slip, move.counts)) / sum;
}

/* --- one Fc for each direction ------------------------------------------------------------------------------------- */

static inline dahl_asymmetric_params_t asymmetric_params(const set_t *set)
{
    const dahl_asymmetric_params_t params = {set->p.sigma0, set->p.Fc, set->p.Fc * set->more, set->p.theta_per_count};
    return params;
}

MODEL_CALLS(asymmetric, asymmetric, element_params)

/* The curve ends at the Fc of its direction, with the presliding length of that direction. */
static inline long double asymmetric_exact(exact_t *exact, move_t move)
{
    const dahl_asymmetric_params_t params = asymmetric_params(exact->set);
    const long double Fc = move.counts < 0 ? params.Fc_backward : params.Fc_forward;
    exact->curve.end = Fc / fmaxf(params.Fc_forward, params.Fc_backward);
    exact->curve.a = params.sigma0 / Fc * params.theta_per_count;
    return reference_move(&exact->curve, move.counts);
}

static inline long double asymmetric_loss(const stroke_t *x)
{
    const dahl_asymmetric_params_t p = asymmetric_params(x->set);
    const float Fc = x->direction > 0 ? p.Fc_forward : p.Fc_backward;
    return (long double)Fc / fmaxf(p.Fc_forward, p.Fc_backward) * (x->travel - rise_of(x)) - stored_by(x);
}

/* --- loaded: Fc and sigma0 follow the load; clamped: Fc alone ------------------------------------------------------ */

MODEL_CALLS(loaded, loaded, element_params)

static inline uint32_t load_in_range(move_t move)
{
    return move.load_q30 < LOAD_MOST ? move.load_q30 : LOAD_MOST;
}

/* The curve is that of F/(c Fc). A falling load scales F down, a growing load keeps F. */
static inline long double loaded_exact(exact_t *exact, move_t move)
{
    const uint32_t load = load_in_range(move);
    if (load > exact->load) {
        exact->curve.w *= (long double)exact->load / load;
    }
    exact->load = load;
    return reference_move(&exact->curve, move.counts) * (load * 0x1p-30L);
}

static inline long double loaded_loss(const stroke_t *x)
{
    return x->load * dahl_loss(x);
}

static inline long double clamped_loss(const stroke_t *x)
{
    return x->load * (x->travel - rise_of(x)) - stored_by(x);
}

static inline float clamped_step(const any_plan_t *plan, any_state_t *state, const set_t *set, move_t move)
{
    return dahl_clamped_step(&plan->dahl, &state->dahl, angle_of(set, move), move.load_q30);
}

/* The curve is that of F/Fc. It ends at the load c, with the presliding length c/a; a falling load clamps F. */
static inline long double clamped_exact(exact_t *exact, move_t move)
{
    const long double c = load_in_range(move) * 0x1p-30L;
    exact->curve.w = fmaxl(-c, fminl(c, exact->curve.w));
    exact->curve.end = c;
    exact->curve.a = c == 0 ? 0 : reference_by_angle(&exact->set->p).a / c;
    return reference_move(&exact->curve, (long double)angle_of(exact->set, move));
}

/* --- elasto-plastic ------------------------------------------------------------------------------------------------ */

MODEL_CALLS(elastoplastic, elastoplastic, element_params)

/* Up to the breakaway b, w changes linearly. Beyond it, the gap to Fc shrinks with the rate 1/(1 - b). */
static inline long double elastoplastic_exact(exact_t *exact, move_t move)
{
    const long double b = exact->set->more, s = move.counts < 0 ? -1 : 1, travel = s * move.counts * exact->curve.a;
    const long double elastic = fminl(travel, fmaxl(0, b - s * exact->curve.w));
    exact->curve.w += s * elastic;
    exact->curve.w -= (s - exact->curve.w) * expm1l(-(travel - elastic) / (1 - b));
    return exact->curve.w;
}

static inline long double elastoplastic_loss(const stroke_t *x)
{
    const long double b = x->set->more, from = fmaxl(x->direction * x->w0, b), to = fmaxl(x->direction * x->w1, from);
    const long double elastic = fminl(fmaxl(b - x->direction * x->w0, 0), x->travel);
    return x->travel - elastic - (to - from) * (1 - b + (to + from) / 2);
}

/* --- Stribeck: only its calls, since its torque depends on speed (test_stribeck.c) ---------------------------------- */

MODEL_CALLS(stribeck, stribeck, element_params)

/* --- the table ----------------------------------------------------------------------------------------------------- */

#define MIX_ERROR_Q30 DAHL_PARALLEL_ERROR_Q30(2)

static const model_t models[] = {
    {"counts", dahl_model_prepare, dahl_model_step, dahl_model_q30, counts_exact, dahl_loss, DAHL_ULP_COUNTS,
     DAHL_ERROR_Q30, .more = MORE_IS_UNUSED},
    {"angle", angle_prepare, angle_step, NULL, angle_exact, dahl_loss, DAHL_ULP_ANGLE, 0, .by_angle = 1},
    {"slip", slip_prepare, slip_step, slip_q30, slip_exact, NULL, DAHL_ULP_PARTS, DAHL_SLIP_ERROR_Q30, .is_split = 1,
     .more = MORE_IS_ELEMENTS},
    {"mix", mix_prepare, mix_step, mix_q30, mix_exact, NULL, DAHL_ULP_PARTS, MIX_ERROR_Q30,
     .more = MORE_IS_ELEMENTS},
    {"asymmetric", asymmetric_prepare, asymmetric_step, asymmetric_q30, asymmetric_exact, asymmetric_loss,
     DAHL_ULP_PARTS, DAHL_ASYMMETRIC_ERROR_Q30, .more = MORE_IS_RATIO},
    {"loaded", loaded_prepare, loaded_step, loaded_q30, loaded_exact, loaded_loss, DAHL_ULP_PARTS,
     DAHL_LOADED_ERROR_Q30, .has_load = 1},
    {"clamped", angle_prepare, clamped_step, NULL, clamped_exact, clamped_loss, DAHL_ULP_ANGLE, 0, .by_angle = 1,
     .has_load = 2},
    {"elastoplastic", elastoplastic_prepare, elastoplastic_step, elastoplastic_q30, elastoplastic_exact,
     elastoplastic_loss, DAHL_ULP_PARTS, DAHL_ELASTOPLASTIC_ERROR_Q30, .more = MORE_IS_BREAKAWAY},
};
enum { MODELS = sizeof models / sizeof models[0] };

static inline const model_t *model_with(more_t more)
{
    for (size_t i = 0; i < MODELS; i++) {
        if (models[i].more == more) {
            return &models[i];
        }
    }
    return NULL;
}

/* set_t.more of a model, of these numbers the one that it has a meaning for. */
static inline float more_for(const model_t *model, float elements, float ratio, float breakaway)
{
    return model->more == MORE_IS_BREAKAWAY ? breakaway : model->more == MORE_IS_RATIO ? ratio : elements;
}

/* The torque that a ratio of 1 means: Fc, the larger Fc, or the sum of all Fc. */
static inline long double whole_of(const model_t *model, const set_t *set)
{
    if (model->step == slip_step || model->step == mix_step) {
        const dahl_slip_params_t params = slip_params(set);
        return slip_reference_Fc(&params) + (model->step == mix_step ? set->p.Fc : 0);
    }
    return model->more == MORE_IS_RATIO ? fmaxf(set->p.Fc, asymmetric_params(set).Fc_backward) : set->p.Fc;
}

/* One ulp of the torque that the bound is relative to. */
static inline long double ulp_now(const model_t *model, const set_t *set, move_t move)
{
    const long double whole = whole_of(model, set), c = load_in_range(move) * 0x1p-30L;
    if (model->has_load == 0) {
        return ulp_of_sum(whole);
    }
    return ulp_of((float)(whole * (model->has_load == 1 || c > 1 ? fmaxl(c, 0x1p-30L) : 1)));
}

static inline void exact_begin(exact_t *exact, const model_t *model, const set_t *set)
{
    memset(exact, 0, sizeof *exact);
    exact->set = set;
    exact->curve = model->by_angle ? reference_by_angle(&set->p) : reference_by_counts(&set->p);
    if (model->more == MORE_IS_ELEMENTS) {
        exact->slip.params = slip_params(set);
    }
}

#endif

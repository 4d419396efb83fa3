/* SPDX-License-Identifier: MIT */
/* Golden bits of the parts: for each parameter set of bits.h the hash of each torque, Q30 value and state, over all hard
 * motions in turn. DAHL_BRISTLE_MODELS has the models with the state of one bristle; any other new part is a function and a
 * row of the table. */
#ifndef BITS_PARTS_H
#define BITS_PARTS_H

#include "bits.h"
#include "dahl_compensator.h"
#include "dahl_parts.h"

#define BITS_PARTS_TICKS (BITS_TICKS / 200) /* an AVR needs a minute for them */

typedef struct {
    uint64_t hash;
    motion_fn next;
    const dahl_params_t *params;
} bits_of_part_t;

/* Three elements, of which one slips far earlier. */
static inline dahl_slip_params_t bits_slip_params(const dahl_params_t *p)
{
    dahl_slip_params_t slip = {3, p->theta_per_count, {0}, {0}};
    for (int k = 0; k < 3; k++) {
        slip.sigma0[k] = p->sigma0;
        slip.Fc[k] = k == 0 ? p->Fc : p->Fc * (k == 1 ? 0.25f : 0.0009765625f);
    }
    return slip;
}

static inline uint64_t bits_fold_slip_plan(uint64_t hash, const dahl_slip_plan_t *plan)
{
    for (unsigned k = 0; k < plan->elements; k++) {
        hash = bits_fold(hash, (uint64_t)plan->element[k].limit << 32 | plan->element[k].weight);
        hash = bits_fold(hash, plan->shift[k]);
    }
    hash = bits_fold(hash, plan->full);
    hash = bits_fold(hash, plan->Fc_mantissa);
    return bits_fold(hash, (uint32_t)plan->Fc_exponent);
}

static inline void bits_slip(bits_of_part_t *run)
{
    dahl_slip_params_t params = bits_slip_params(run->params);
    dahl_slip_plan_t plan;
    dahl_slip_state_t torque = {{0}}, q30 = {{0}};
    motion_t motion = MOTION_START;
    if (dahl_slip_prepare(&plan, &params) != DAHL_OK) {
        return;
    }
    run->hash = bits_fold_slip_plan(run->hash, &plan);
    for (int32_t t = 0; t < BITS_PARTS_TICKS; t++) {
        int32_t d = run->next(&motion);
        run->hash = bits_fold(run->hash, bits_of_float(dahl_slip_step_counts(&plan, &torque, d)));
        run->hash = bits_fold(run->hash, (uint32_t)dahl_slip_step_counts_q30(&plan, &q30, d));
        for (unsigned k = 0; k < plan.elements; k++) {
            run->hash = bits_fold(run->hash, (uint32_t)q30.x[k]);
        }
    }
}

/* A Dahl element and slip elements of an eighth of its torque. */
static inline void bits_mix(bits_of_part_t *run)
{
    dahl_slip_params_t slip_params = bits_slip_params(run->params);
    dahl_params_t params = *run->params;
    dahl_slip_plan_t slip_plan;
    dahl_plan_t plan;
    dahl_slip_state_t slip = {{0}};
    dahl_state_t dahl = {0};
    dahl_part_t parts[] = {DAHL_SLIP_PART(&slip_plan, &slip), DAHL_PART(&plan, &dahl)};
    int32_t shares[2];
    motion_t motion = MOTION_START;
    params.Fc *= 8;
    if (dahl_slip_prepare(&slip_plan, &slip_params) != DAHL_OK || dahl_prepare(&plan, &params) != DAHL_OK) {
        return;
    }
    dahl_parallel_shares(shares, parts, 2);
    for (int32_t t = 0; t < BITS_PARTS_TICKS; t++) {
        int32_t d = run->next(&motion);
        run->hash = bits_fold(run->hash, bits_of_float(dahl_parallel_step_counts(parts, 2, d)));
        run->hash = bits_fold(run->hash, (uint32_t)dahl_parallel_step_counts_q30(parts, shares, 2, -(d / 2)));
    }
}

/* Work, moves to +Fc/2 and -Fc/4, the tip of each stroke, and a Stribeck curve. */
static inline void bits_beside(bits_of_part_t *run)
{
    dahl_velocity_params_t curve = {2, {0}};
    dahl_velocity_plan_t velocity;
    dahl_plan_t plan;
    dahl_state_t state = {0};
    dahl_work_t work = {{0}, {0}};
    motion_t motion = MOTION_START;
    for (int k = 0; k < DAHL_VELOCITY_SEGMENTS; k++) {
        curve.torque[k] = run->params->Fc * (float)((k - 5) * (k - 5) - 19) * 0.0625f;
    }
    if (dahl_prepare(&plan, run->params) != DAHL_OK || dahl_velocity_prepare(&velocity, &curve) != DAHL_OK) {
        return;
    }
    for (int32_t t = 0; t < BITS_PARTS_TICKS; t++) {
        int32_t d = run->next(&motion), n = 0;
        run->hash = bits_fold(run->hash, bits_of_float(dahl_work_step_counts(&plan, &state, &work, d)));
        run->hash = bits_fold(run->hash, bits_of_float(dahl_velocity_torque(&velocity, d)));
        if (t % 64 == 0) {
            run->hash = bits_fold(run->hash, bits_of_float(dahl_work(run->params, &work)));
            run->hash = bits_fold(run->hash, bits_of_float(dahl_tip_torque(&plan, (uint32_t)d)));
            dahl_err_t err = dahl_counts_to_torque(&plan, &state, run->params->Fc * (t % 128 ? 0.5f : -0.25f), &n);
            run->hash = bits_fold(run->hash, (uint64_t)(uint32_t)n << 8 | (err != DAHL_OK));
        }
    }
}

/* A model with the state of one bristle. The second Fc is that of the backward direction. */
static inline void bits_of_model(bits_of_part_t *run, const dahl_model_t *model)
{
    const dahl_params_t *p = run->params;
    const dahl_model_params_t params = {{1, p->theta_per_count, {p->sigma0}, {p->Fc, 0.5f * p->Fc}}, 0, 0.7f};
    dahl_any_plan_t plan;
    dahl_state_t torque = {0}, q30 = {0};
    motion_t motion = MOTION_START;
    if (model->q30->prepare(&plan, &params) != DAHL_OK) {
        return;
    }
    for (int32_t t = 0; t < BITS_PARTS_TICKS; t++) {
        int32_t d = run->next(&motion);
        run->hash = bits_fold(run->hash, bits_of_float(model->step(&plan, &torque, d, 0)));
        run->hash = bits_fold(run->hash, (uint32_t)model->q30->step_q30(&plan, &q30, d, 0));
        run->hash = bits_fold(run->hash, (uint64_t)q30.w);
    }
}

#define BITS_OF_MODEL(name, ...)                                                                                               \
    static inline void bits_##name(bits_of_part_t *run)                                                                        \
    {                                                                                                                          \
        bits_of_model(run, &dahl_model_##name);                                                                                \
    }
DAHL_BRISTLE_MODELS(BITS_OF_MODEL)

static inline void bits_loaded(bits_of_part_t *run)
{
    dahl_plan_t plan;
    dahl_loaded_state_t torque = {{0}, 0}, q30 = {{0}, 0};
    motion_t motion = MOTION_START, loading = MOTION_START;
    if (dahl_prepare(&plan, run->params) != DAHL_OK) {
        return;
    }
    for (int32_t t = 0; t < BITS_PARTS_TICKS; t++) {
        int32_t d = run->next(&motion);
        uint32_t load = motion_random(&loading) >> (t % 8);
        run->hash = bits_fold(run->hash, bits_of_float(dahl_loaded_step_counts(&plan, &torque, d, load)));
        run->hash = bits_fold(run->hash, (uint32_t)dahl_loaded_step_counts_q30(&plan, &q30, d, load));
        run->hash = bits_fold(run->hash, (uint64_t)q30.bristle.w);
    }
}

static inline void bits_clamped(bits_of_part_t *run)
{
    dahl_plan_t plan;
    dahl_state_t state = {0};
    motion_t motion = MOTION_START, loading = MOTION_START;
    if (dahl_prepare(&plan, run->params) != DAHL_OK) {
        return;
    }
    for (int32_t t = 0; t < BITS_PARTS_TICKS; t++) {
        volatile float counts = (float)run->next(&motion);
        volatile float dtheta = counts * run->params->theta_per_count;
        uint32_t load = motion_random(&loading) >> (t % 8);
        run->hash = bits_fold(run->hash, bits_of_float(dahl_clamped_step(&plan, &state, dtheta, load)));
        run->hash = bits_fold(run->hash, (uint64_t)state.w);
    }
}

/* Bounds are 0, because a quotient of floats would depend on the compiler. */
static inline dahl_compensator_params_t bits_compensator_params(const dahl_params_t *p)
{
    const dahl_compensator_params_t params = {
        .friction = *p,
        .law = DAHL_COMPENSATOR_REFERENCE,
        .gain = 0.9f,
        .limit = 0.5f * p->Fc,
        .slew = 16.0f * p->Fc,
        .period = 0x1p-10f,
        .rise = 0.05f,
        .fall = 0.02f,
        .fade_speed = 4096.0f * p->theta_per_count,
        .noise = 1,
        .play = 3,
        .jump = 3999,
    };
    return params;
}

static inline uint64_t bits_fold_compensator_plan(uint64_t hash, const dahl_compensator_plan_t *plan)
{
    hash = bits_fold(hash, (uint64_t)plan->gain_q16 << 32 | (uint32_t)plan->limit_q30);
    hash = bits_fold(hash, (uint64_t)plan->rise_q30 << 32 | plan->fall_q30);
    hash = bits_fold(hash, (uint64_t)plan->slew_q30 << 32 | plan->speed_unit);
    return bits_fold(hash, plan->speed_shift);
}

/* Change to other units and back; the bristle keeps its ratio. */
static inline uint64_t bits_change_compensator(uint64_t hash, const dahl_compensator_plan_t *plan,
                                               const dahl_compensator_plan_t *other, dahl_compensator_t *compensator)
{
    dahl_compensator_change(plan, other, compensator);
    hash = bits_fold(hash, (uint64_t)(uint32_t)compensator->torque_q30 << 32 | (uint32_t)compensator->speed_q20);
    dahl_compensator_change(other, plan, compensator);
    return bits_fold(hash, (uint64_t)(uint32_t)compensator->ratio_q30 << 32 | (uint32_t)compensator->play_position);
}

static inline void bits_compensator(bits_of_part_t *run)
{
    dahl_compensator_params_t params = bits_compensator_params(run->params);
    dahl_compensator_plan_t plan, other;
    dahl_plan_t element;
    dahl_compensator_t compensator = {0};
    dahl_state_t bristle = {0};
    motion_t motion = MOTION_START, faults = MOTION_START;
    if (dahl_prepare(&element, run->params) != DAHL_OK || dahl_compensator_prepare(&plan, &params) != DAHL_COMPENSATOR_OK) {
        return;
    }
    params.friction.Fc *= 0.75f;
    params.fade_speed *= 1.25f;
    params.play = 5;
    if (dahl_compensator_prepare(&other, &params) != DAHL_COMPENSATOR_OK) {
        return;
    }
    run->hash = bits_fold_compensator_plan(run->hash, &plan);
    for (int32_t t = 0; t < BITS_PARTS_TICKS; t++) {
        int32_t d = run->next(&motion);
        int32_t move = dahl_compensator_move(&plan, &compensator, d, motion_random(&faults) % 64u > 4u);
        int32_t ratio = dahl_step_counts_q30(&element, &bristle, move);
        run->hash = bits_fold(run->hash, (uint32_t)dahl_compensator_torque(&plan, &compensator, ratio));
        run->hash = bits_fold(run->hash, (uint32_t)compensator.speed_q20);
        run->hash = bits_fold(run->hash, (uint64_t)bristle.w);
        if (t % 97 == 0) {
            run->hash = bits_change_compensator(run->hash, &plan, &other, &compensator);
        }
    }
}

static inline uint64_t bits_fold_residual_plan(uint64_t hash, const dahl_residual_plan_t *plan)
{
    hash = bits_fold(hash, (uint64_t)(uint32_t)plan->step_q32 << 32 | (uint32_t)plan->share_q32);
    hash = bits_fold(hash, (uint64_t)(uint32_t)plan->momentum_q24 << 32 | (uint32_t)plan->limit_q24);
    hash = bits_fold(hash, (uint64_t)plan->Fc_mantissa << 32 | (uint32_t)plan->Fc_exponent);
    hash = bits_fold(hash, (uint64_t)plan->per_torque_mantissa << 32 | (uint32_t)plan->torque_shift);
    return bits_fold(hash, plan->slew_q24);
}

/* The residual observer with bad readings, and presliding damping. Torques in N m are rounded once, like a float. */
static inline void bits_residual(bits_of_part_t *run)
{
    dahl_compensator_params_t params = bits_compensator_params(run->params);
    const dahl_residual_params_t observer = {.inertia = 0x1p-9f * run->params->Fc, .corner = 15.0f,
                                             .limit = 0.5f * run->params->Fc, .resonance = 150.0f, .delay = 2,
                                             .no_integral = 1};
    dahl_compensator_plan_t plan;
    dahl_residual_plan_t residual_plan, other;
    dahl_damping_plan_t damping_plan;
    dahl_plan_t element;
    dahl_compensator_t compensator = {0};
    dahl_residual_t residual = {0};
    dahl_damping_t damping = {0};
    dahl_state_t bristle = {0};
    motion_t motion = MOTION_START, faults = MOTION_START;
    if (dahl_prepare(&element, run->params) != DAHL_OK || dahl_compensator_prepare(&plan, &params) != DAHL_COMPENSATOR_OK
        || dahl_damping_prepare(&damping_plan, run->params, 0x1p-8f * run->params->sigma0, 0x1p-10f) != DAHL_OK
        || dahl_residual_prepare(&residual_plan, &params, &observer) != DAHL_COMPENSATOR_OK) {
        return;
    }
    params.friction.Fc *= 0.75f;
    if (dahl_residual_prepare(&other, &params, &observer) != DAHL_COMPENSATOR_OK) {
        return;
    }
    run->hash = bits_fold(bits_fold_residual_plan(run->hash, &residual_plan), (uint32_t)damping_plan.gain_q16);
    for (int32_t t = 0; t < BITS_PARTS_TICKS; t++) {
        int32_t d = run->next(&motion);
        (void)dahl_compensator_move(&plan, &compensator, d, motion_random(&faults) % 64u > 4u);
        int32_t damped = dahl_damping_apply(&damping_plan, &damping, dahl_step_counts_q30(&element, &bristle, d));
        volatile float torque = (float)(damped >> 8) * 0x1p-20f * run->params->Fc;
        run->hash = bits_fold(run->hash, (uint32_t)dahl_residual_torque(&residual_plan, &residual, &compensator, d));
        dahl_residual_note(&residual, dahl_residual_q24(&residual_plan, torque));
        run->hash = bits_fold(run->hash, (uint64_t)residual.raw_q56);
        run->hash = bits_fold(run->hash, (uint64_t)(uint32_t)damped << 32 | (uint32_t)residual.unexplained_q24[0]);
        if (t % 97 == 0) {
            dahl_residual_change(&residual_plan, &other, &residual);
            run->hash = bits_fold(run->hash, (uint64_t)residual.filtered_q56);
            dahl_residual_change(&other, &residual_plan, &residual);
        }
    }
}

typedef void (*bits_fold_part_t)(bits_of_part_t *run);

#define BITS_ROW(name, ...) {#name, bits_##name},
static const struct {
    const char *name;
    bits_fold_part_t fold;
} bits_parts[] = {
    {"slip", bits_slip},
    {"mix", bits_mix},
    {"beside", bits_beside},
    {"loaded", bits_loaded},
    {"clamped", bits_clamped},
    {"compensator", bits_compensator},
    {"residual", bits_residual},
    DAHL_BRISTLE_MODELS(BITS_ROW)
};

#define BITS_PARTS_RUNS (BITS_PARAMS * (sizeof bits_parts / sizeof bits_parts[0]))

static inline uint64_t bits_of_part(bits_fold_part_t fold, unsigned set)
{
    bits_of_part_t part = {14695981039346656037u, motions[0].next, &bits_params[set]};
    for (unsigned m = 0; m < MOTIONS; m++) {
        part.next = motions[m].next;
        fold(&part);
    }
    return part.hash;
}

static inline uint64_t bits_parts_run(unsigned run)
{
    return bits_of_part(bits_parts[run / BITS_PARAMS].fold, run % BITS_PARAMS);
}

#endif

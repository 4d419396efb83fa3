/* SPDX-License-Identifier: MIT */
/* friction: see friction.h. */
#include "friction.h"

#include <string.h>

#define TWO_30 0x1p30        /* of a ratio in Q30 */
#define FINE_TRAVEL 0x1p-20f /* [presliding lengths] of one count */
#define MOVE_MAX 0x1p36      /* 64 presliding lengths or more: every element is at its end */
#define PART_MAX 0x7fffff00p0  /* and the rounding of 64 parts fits an int32_t */
#define TWO_52 0x1p52        /* a double from here on is an integer */

#define ROW(name, NAME, Class, number, sigma0s, Fcs, plan, key, meaning, low, high) {#name, key, low, high, &dahl_model_##name},
const friction_model_t friction_models[FRICTION_MODELS] = {DAHL_MODELS(ROW)};

static const dahl_model_q30_t *calls_of(const friction_t *f)
{
    return friction_models[f->model].calls->q30;
}

uint32_t friction_find(const char *name)
{
    uint32_t model = 0;
    while (model < FRICTION_MODELS && strcmp(friction_models[model].name, name) != 0) {
        model++;
    }
    return model;
}

uint32_t friction_count_words(const friction_t *f)
{
    return calls_of(f)->state_bytes / (uint32_t)sizeof(uint32_t);
}

static float fine_count(const friction_t *f)
{
    const dahl_slip_params_t *each = &f->params.each;
    float least = each->Fc[0] / each->sigma0[0];
    for (uint32_t k = 1; k < each->elements; k++) {
        const float length = each->Fc[k] / each->sigma0[calls_of(f)->sigma0s == 1 ? 0 : k];
        least = length < least ? length : least;
    }
    return FINE_TRAVEL * least;
}

static double full_torque(const friction_t *f)
{
    double full = 0.0;
    for (uint32_t k = 0; k < f->params.each.elements; k++) {
        const double Fc = (double)f->params.each.Fc[k];
        full = calls_of(f)->Fcs != 2 ? full + Fc : Fc > full ? Fc : full;
    }
    return full;
}

static double full_stiffness(const friction_t *f)
{
    const dahl_slip_params_t *each = &f->params.each;
    double full = (double)each->sigma0[0];
    for (uint32_t k = 1; k < each->elements && calls_of(f)->sigma0s != 1; k++) {
        full += (double)each->sigma0[k];
    }
    return full;
}

dahl_err_t friction_prepare(friction_t *f)
{
    if (f->model >= FRICTION_MODELS) {
        return DAHL_ERR_PARAM;
    }
    if (f->model != FRICTION_DAHL && !f->is_stiffness_fixed && !(f->params.each.theta_per_count > 0.0f)) {
        f->params.each.theta_per_count = fine_count(f);
    }
    f->Fc = full_torque(f);
    f->sigma0 = full_stiffness(f);
    return calls_of(f)->prepare(&f->plan, &f->params);
}

/* Round to the nearest integer, a half to the even one, as rint() does. An FMU is not linked with libm. */
static double nearest(double x)
{
    const double shift = x < 0.0 ? -TWO_52 : TWO_52;
    return x < TWO_52 && x > -TWO_52 ? (x + shift) - shift : x;
}

double friction_position(const friction_t *f, double angle)
{
    const double theta = (double)f->params.each.theta_per_count;
    return theta > 0.0 ? nearest(angle / theta) : angle;
}

/* NaN becomes -limit. */
static double clamp_to(double x, double limit)
{
    return x > limit ? limit : x > -limit ? x : -limit;
}

/* Split a move that an int32_t cannot hold into parts of nearly equal speed. Do all but the last, and return the last. */
static int32_t move_excess(const friction_t *f, friction_state_t *state, double counts, uint32_t load_q30)
{
    double left = clamp_to(counts, MOVE_MAX), part = left;
    uint32_t parts = 1;
    for (; part > PART_MAX || part < -PART_MAX; part *= 0.5) {
        parts *= 2;
    }
    part = nearest(part);
    for (; parts > 1; parts--) {
        (void)calls_of(f)->step_q30(&f->plan, state, (int32_t)part, load_q30);
        left -= part;
    }
    return (int32_t)left;
}

static uint32_t q30_of(double load)
{
    const double load_q30 = nearest(load * TWO_30);
    return (uint32_t)load_q30;
}

float friction_move(const friction_t *f, friction_state_t *state, double distance, double load)
{
    const uint32_t load_q30 = q30_of(load);
    if (f->is_stiffness_fixed) {
        return dahl_clamped_step(&f->plan.dahl, &state->any.dahl, (float)distance, load_q30);
    }
    if (!(f->params.each.theta_per_count > 0.0f)) {
        return dahl_step(&f->plan.dahl, &state->any.dahl, (float)distance);
    }
    const int32_t dcounts = move_excess(f, state, distance, load_q30);
    return friction_models[f->model].calls->step(&f->plan, state, dcounts, load_q30);
}

int32_t friction_move_q30(const friction_t *f, friction_state_t *state, double counts, double load)
{
    const uint32_t load_q30 = q30_of(load);
    return calls_of(f)->step_q30(&f->plan, state, move_excess(f, state, counts, load_q30), load_q30);
}

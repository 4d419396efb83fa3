/* SPDX-License-Identifier: MIT */
/* Compare the result of a commissioning with the true values of a random axis. */
#ifndef TEST_AXIS_CHECKS_H
#define TEST_AXIS_CHECKS_H

#include "random_axis.h"

#define RIGID_SECONDS 60 /* a random axis must end within it */
#define FLEXIBLE_SECONDS 90
#define FLEXIBLE_TRIES 3

/* True values in the unit of the command: the friction over both directions and the travel. */
typedef struct {
    double least, mean, most, length, sigma0, inertia, delay, viscous;
} truth_t;

static inline truth_t truth_of(const axis_t *axis)
{
    truth_t truth = {.least = INFINITY};
    for (int k = 0; k < 400; k++) {
        double friction = coulomb(axis, axis->travel * (k / 200.0 - 1), k & 1 ? 1 : -1) / axis->torque_constant;
        truth.least = fmin(truth.least, friction);
        truth.most = fmax(truth.most, friction);
        truth.mean += friction / 400;
    }
    truth.sigma0 = axis->sigma0 / axis->torque_constant;
    truth.length = axis->breakaway * truth.most / truth.sigma0;
    truth.inertia = axis->inertia / axis->torque_constant;
    truth.delay = axis->delay * axis->period + axis->lag;
    truth.viscous = axis->viscous / axis->torque_constant;
    return truth;
}

static inline int has(const dahl_commission_range_t *range, double value)
{
    return (double)range->least <= value && value <= (double)range->most;
}

static inline int is_close(const dahl_commission_range_t *range, double value)
{
    return fabs((double)range->best / value - 1) < 0.05;
}

static inline int has_load(const axis_t *axis, const dahl_commission_result_t *result)
{
    double error = 0;
    for (int bin = 0; bin < DAHL_COMMISSION_BINS; bin++) {
        double angle = axis->travel * ((2 * bin + 1.0) / DAHL_COMMISSION_BINS - 1);
        error = fmax(error, fabs(load_torque(axis, angle) / axis->torque_constant - (double)result->load[bin]));
    }
    return error <= (double)result->load_error;
}

static inline float gain_of(const dahl_commission_t *state, int has_load)
{
    dahl_compensator_params_t params;
    return dahl_commission_params(state, &params, has_load) == DAHL_COMPENSATOR_OK ? params.gain : 0;
}

/* Rest is that of dahl_compensator.h: not faster than without the law, and without a load, by more than this.
 * has_load: the firmware has no table of the load. A gain of 0 then says that the load is too large to compensate. */
static inline int rests(const axis_t *axis, const dahl_commission_t *state, int has_load)
{
    if (has_load && !(gain_of(state, has_load) > 0)) {
        return 1;
    }
    const double more = fmax(0.02, 2 * axis->count * sqrt(axis->sigma0 / axis->inertia));
    axis_t unloaded = *axis;
    unloaded.gravity = unloaded.cogging = 0;
    for (int kick = 0; kick < 4; kick++) {
        double push = (kick & 1 ? -1 : 1) * (1.3 + kick) * axis->Fc;
        double speed = speed_after_push(axis, state, has_load, push);
        if (!(speed < more) && !(speed < more + speed_after_push(&unloaded, NULL, 0, push))) {
            return 0;
        }
    }
    return 1;
}

/* Lines of the table of docs/commissioning.md, which an axis passes or not, and the share that must pass. */
enum { BOUNDS, FC_LOW, LENGTH, FC, INERTIA, INERTIA_RANGE, DELAY, SIGMA0, VISCOUS, LOAD, SECONDS, RESTS, RESTS_LOADED, LINES };
static const struct {
    const char *name;
    double share;
} lines[LINES] = {{"bounds", 0.98},
                  {"`Fc_low` is true", 0.98},
                  {"`length_long` is true", 0.98},
                  {"mean Fc is within 5 %", 0.98},
                  {"inertia is within 5 %", 0.98},
                  {"inertia is in its interval", 0.98},
                  {"delay is in its interval", 0.98},
                  {"`sigma0_high` is true", 0.98},
                  {"viscous friction is in its interval", 0.95},
                  {"load is in its interval", 0.9},
                  {"done in 25 s", 0.95},
                  {"rest after pushes, with the load fed forward", 1},
                  {"rest after pushes, without the load table", 1}};

static inline void count_axis(const axis_t *axis, const dahl_commission_t *state, int passed[])
{
    const dahl_commission_result_t *result = &state->result;
    const truth_t truth = truth_of(axis);
    passed[BOUNDS]++;
    passed[FC_LOW] += (double)result->Fc.least <= truth.least;
    passed[LENGTH] += (double)result->length.most >= truth.length;
    passed[FC] += is_close(&result->Fc, truth.mean);
    passed[INERTIA] += is_close(&result->inertia, truth.inertia);
    passed[INERTIA_RANGE] += has(&result->inertia, truth.inertia);
    passed[DELAY] += has(&result->delay, truth.delay);
    passed[SIGMA0] += (double)result->sigma0.most >= truth.sigma0;
    passed[VISCOUS] += has(&result->viscous, truth.viscous);
    passed[LOAD] += has_load(axis, result);
    passed[SECONDS] += (double)result->seconds <= 25;
    passed[RESTS] += rests(axis, state, 0);
    passed[RESTS_LOADED] += rests(axis, state, 1);
}

/* Commission an axis with a shaft. After each refusal, try again at half the bandwidth of the loop. */
static inline dahl_commission_t commission_flexible(axis_t *axis, int *tries)
{
    motion_t motion;
    dahl_commission_t state = commission_axis(axis, &motion, FLEXIBLE_SECONDS);
    for (*tries = 1; *tries < FLEXIBLE_TRIES && state.command.stage != DAHL_COMMISSION_DONE; ++*tries) {
        axis->loop_hz /= 2;
        state = commission_axis(axis, &motion, FLEXIBLE_SECONDS);
    }
    return state;
}

static inline int bounds_rotor(const axis_t *axis, const dahl_commission_result_t *result)
{
    return (double)result->inertia.least <= axis->inertia / axis->torque_constant;
}

#endif

/* SPDX-License-Identifier: MIT */
/* A simulated axis in double precision and its firmware, shared by the tests of compensation.
 *
 * The axis is one mass, or two with a shaft between them, with friction on each. Motor and encoder are on the first mass. The
 * encoder has noise. The torque is held for a tick, acts some ticks late, and has the lag of a current loop. */
#ifndef TEST_AXIS_H
#define TEST_AXIS_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#include <unity.h>

#include "../random.h"
#include "dahl_compensator.h"

#define TWO_PI 6.283185307179586
#define SUBSTEP_ANGLE 0.06 /* rad of the fastest swing in a substep */

enum { MOTOR, LOAD, MASSES, SPRINGS = 5, LATEST = 8 };

static inline double uniform(uint64_t *random, double least, double most)
{
    return least + (most - least) * (random_u32(random) * 0x1p-32);
}

/* --- friction --------------------------------------------------------------------------------------------------------- */

/* Dahl's model. With a stribeck_speed, the friction rises towards rest to the breakaway torque: LuGre's model, with sigma1. With
 * springs, they slip one after the other: Maxwell's model. */
typedef struct {
    double Fc, sigma0;                /* N m, N m/rad of the steepest slope; Fc 0: no friction */
    double backward, viscous;         /* Fc backward less that forward, in N m; N m s/rad */
    double breakaway, stribeck_speed; /* N m, rad/s */
    double sigma1;                    /* N m s/rad */
    int springs;
} friction_t;

typedef struct {
    double spring[SPRINGS]; /* N m; without slip, the first is the bristle */
} bristle_t;

static inline double friction_limit(const friction_t *f, double speed)
{
    const double Fc = f->Fc + (speed < 0 ? f->backward : 0);
    if (f->stribeck_speed <= 0) {
        return Fc;
    }
    const double ratio = speed / f->stribeck_speed;
    return Fc + (f->breakaway - f->Fc) * exp(-ratio * ratio);
}

static inline double slip_move(const friction_t *f, bristle_t *bristle, double dtheta)
{
    double work = 0;
    for (int k = 0; k < f->springs; k++) {
        const double Fc = f->Fc * (2 * k + 1) / (f->springs * f->springs), force = bristle->spring[k];
        bristle->spring[k] = fmax(-Fc, fmin(Fc, force + f->sigma0 / f->springs * dtheta));
        work += bristle->spring[k] * dtheta;
    }
    return work;
}

/* The integral over a step is exact for Dahl's model. Return the work done against the bristles. */
static inline double friction_move(const friction_t *f, bristle_t *bristle, double dtheta, double speed)
{
    if (f->springs > 0) {
        return slip_move(f, bristle, dtheta);
    }
    const double sign = dtheta < 0 ? -1 : 1, Fc = friction_limit(f, speed);
    if (Fc <= 0) {
        return 0;
    }
    const double gap = sign * Fc - bristle->spring[0], closed = -gap * expm1(-f->sigma0 / Fc * fabs(dtheta));
    bristle->spring[0] += closed;
    return sign * Fc * dtheta - sign * closed * Fc / f->sigma0;
}

static inline double friction_torque(const friction_t *f, const bristle_t *bristle, double speed)
{
    double torque = f->viscous * speed;
    for (int k = 0; k < (f->springs > 0 ? f->springs : 1); k++) {
        torque += bristle->spring[k];
    }
    if (f->sigma1 > 0) {
        torque += f->sigma1 * (speed - bristle->spring[0] * fabs(speed) / friction_limit(f, speed));
    }
    return torque;
}

/* --- axis ------------------------------------------------------------------------------------------------------------- */

typedef struct {
    double inertia[MASSES]; /* kg m2; without a second one, the axis is rigid */
    friction_t friction[MASSES];
    double shaft, damping; /* N m/rad, N m s/rad between the masses */
    double load;           /* N m, constant, in the direction of the angle */
    double period, lag;    /* s of a tick, s of the current loop */
    int delay;             /* ticks from a command to its torque */
    double count;          /* rad */
    int noise, is_noise_after_rounding; /* counts */
} axis_t;

typedef struct {
    double theta[MASSES], speed[MASSES];
    bristle_t bristle[MASSES];
    double torque, commands[LATEST]; /* N m of the motor now; of the last ticks */
    uint64_t random;
    int32_t counts;
} motion_t;

static inline int is_elastic(const axis_t *axis)
{
    return axis->inertia[LOAD] > 0;
}

static inline double sigma0_of(const axis_t *axis)
{
    return axis->friction[MOTOR].sigma0 + axis->friction[LOAD].sigma0;
}

static inline double Fc_of(const axis_t *axis)
{
    return axis->friction[MOTOR].Fc + axis->friction[LOAD].Fc;
}

/* rad/s of the motor on the bristles. */
static inline double bristle_frequency(const axis_t *axis)
{
    return sqrt(sigma0_of(axis) / axis->inertia[MOTOR]);
}

/* Largest speed of swings in which no slip element slips. They lose no energy, with a law or without. */
static inline double lossless_speed(const axis_t *axis)
{
    const friction_t *f = &axis->friction[axis->friction[MOTOR].Fc > 0 ? MOTOR : LOAD];
    return f->springs > 0 ? f->Fc / f->sigma0 / f->springs * bristle_frequency(axis) : 0;
}

/* The noise is uniform in +-noise: of whole counts if it is added after the rounding. */
static inline int32_t read_counts(const axis_t *axis, motion_t *m)
{
    const uint32_t random = random_u32(&m->random);
    const double counts = m->theta[MOTOR] / axis->count;
    if (axis->is_noise_after_rounding) {
        return (int32_t)floor(counts) + (int32_t)(random % (2 * (uint32_t)axis->noise + 1)) - axis->noise;
    }
    return (int32_t)floor(counts + axis->noise * (random * 0x1p-31 - 1));
}

/* Return the move since the last reading. */
static inline int32_t read_move(const axis_t *axis, motion_t *m)
{
    const int32_t before = m->counts;
    m->counts = read_counts(axis, m);
    return m->counts - before;
}

/* Semi-implicit: first the speeds, then angles and friction. */
static inline void substep(const axis_t *axis, motion_t *m, double external, double h)
{
    const int masses = is_elastic(axis) ? 2 : 1;
    const double twist = m->theta[MOTOR] - m->theta[LOAD], rate = m->speed[MOTOR] - m->speed[LOAD];
    const double shaft = masses == 2 ? axis->shaft * twist + axis->damping * rate : 0;
    const double torques[MASSES] = {m->torque - shaft + (masses == 1 ? external : 0), shaft + external};
    for (int k = 0; k < masses; k++) {
        const friction_t *friction = &axis->friction[k];
        m->speed[k] += (torques[k] - friction_torque(friction, &m->bristle[k], m->speed[k])) / axis->inertia[k] * h;
        const double move = m->speed[k] * h;
        m->theta[k] += move;
        (void)friction_move(friction, &m->bristle[k], move, m->speed[k]);
    }
}

static inline int substeps_of(const axis_t *axis)
{
    double square = sigma0_of(axis) / axis->inertia[MOTOR];
    if (is_elastic(axis)) {
        square += axis->shaft * (1 / axis->inertia[MOTOR] + 1 / axis->inertia[LOAD]);
        square += axis->friction[LOAD].sigma0 / axis->inertia[LOAD];
    }
    return (int)fmax(4, ceil(axis->period * sqrt(square) / SUBSTEP_ANGLE));
}

static inline void send_command(motion_t *m, double command)
{
    memmove(&m->commands[1], &m->commands[0], (LATEST - 1) * sizeof m->commands[0]);
    m->commands[0] = command;
}

/* Advance by a tick. */
static inline void advance(const axis_t *axis, motion_t *m, double external)
{
    const int substeps = substeps_of(axis);
    const double h = axis->period / substeps, closed = axis->lag > 0 ? 1 - exp(-h / axis->lag) : 1;
    for (int k = 0; k < substeps; k++) {
        m->torque += (m->commands[axis->delay] - m->torque) * closed;
        substep(axis, m, axis->load + external, h);
    }
}

static inline double fastest(const axis_t *axis, const motion_t *m)
{
    return fmax(fabs(m->speed[MOTOR]), is_elastic(axis) ? fabs(m->speed[LOAD]) : 0);
}

/* --- firmware --------------------------------------------------------------------------------------------------------- */

typedef struct {
    dahl_compensator_params_t params;
    dahl_plan_t element;
    dahl_state_t bristle;
    dahl_compensator_plan_t plan;
    dahl_compensator_t compensator;
    double torque; /* N m */
} firmware_t;

static inline void prepare_firmware(firmware_t *f, const dahl_compensator_params_t *params)
{
    f->params = *params;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_prepare(&f->element, &params->friction));
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_compensator_prepare(&f->plan, params));
}

/* Between two ticks, as examples/change_parameters does. */
static inline void change_firmware(firmware_t *f, const dahl_compensator_params_t *params)
{
    firmware_t next = *f;
    prepare_firmware(&next, params);
    dahl_change_plan(&f->element, &next.element, &next.bristle);
    dahl_compensator_change(&f->plan, &next.plan, &next.compensator);
    *f = next;
}

/* Limit and slew hold in N m. A new limit below the torque counts before the slew. */
static inline void check_torque(const dahl_compensator_params_t *params, double before, double torque)
{
    const double limit = fmin((double)params->limit, 2 * (double)params->friction.Fc);
    const double step = (double)params->slew * (double)params->period;
    TEST_ASSERT_TRUE(fabs(torque) <= limit * (1 + 1e-6));
    TEST_ASSERT_TRUE(fabs(torque - before) <= step * (1 + 1e-6) || fabs(before) > limit);
}

/* Return the torque of a tick in N m; reference_move: with the reference law. */
static inline double compensate(firmware_t *f, int32_t dcounts, int is_good, int32_t reference_move)
{
    const int32_t measured = dahl_compensator_move(&f->plan, &f->compensator, dcounts, is_good);
    const int32_t move = f->params.law == DAHL_COMPENSATOR_MEASURED ? measured : reference_move;
    const int32_t ratio = dahl_step_counts_q30(&f->element, &f->bristle, move);
    const double before = f->torque;
    f->torque = dahl_compensator_torque(&f->plan, &f->compensator, ratio) * (double)DAHL_Q30 * (double)f->params.friction.Fc;
    check_torque(&f->params, before, f->torque);
    return f->torque;
}

/* --- position loops --------------------------------------------------------------------------------------------------- */

typedef enum { PD, PID, CASCADE, LOOPS } loop_kind_t;

/* The speed is that of the counts behind a low-pass. */
typedef struct {
    loop_kind_t kind;
    double kp, kd, ki; /* N m/rad, N m s/rad; per s: of the error, or of the speed error of a cascade with kp/kd of the angle */
    double corner;     /* Hz of the low-pass */
} loop_t;

typedef struct {
    double speed, integral;
} loop_state_t;

static inline void update_speed(const loop_t *loop, loop_state_t *state, double move, double period)
{
    state->speed += (1 - exp(-TWO_PI * loop->corner * period)) * (move / period - state->speed);
}

/* Return the torque of the loop. */
static inline double feedback(const loop_t *loop, loop_state_t *state, double error, double speed_error, double period)
{
    if (loop->kind == CASCADE) {
        const double speed = loop->kp / loop->kd * error + speed_error;
        state->integral += loop->ki * speed * period;
        return loop->kd * speed + state->integral;
    }
    state->integral += loop->kind == PID ? loop->ki * error * period : 0;
    return loop->kp * error + loop->kd * speed_error + state->integral;
}

#endif

/* SPDX-License-Identifier: MIT */
/* An axis in double precision: rotor, true friction, encoder with noise, delay of the drive, position loop. The compensator
 * under test adds its torque. The true friction is integrated here, not by the library. */
#ifndef AXIS_H
#define AXIS_H

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "../random.h"
#include "dahl_compensator.h"

static inline void at_most(double limit, double value)
{
    char message[64];
    snprintf(message, sizeof message, "%g is above %g", value, limit);
    TEST_ASSERT_TRUE_MESSAGE(value <= limit, message);
}

static inline void at_least(double limit, double value)
{
    char message[64];
    snprintf(message, sizeof message, "%g is below %g", value, limit);
    TEST_ASSERT_TRUE_MESSAGE(value >= limit, message);
}

#define TWO_PI 6.283185307179586
#define TRUE_FC 0.5       /* N m */
#define TRUE_SIGMA0 100.0 /* N m/rad: a presliding length of 5 mrad */
#define SUBSTEP_S 62.5e-6

/* True friction: Dahl's model. With a stribeck_speed it is LuGre's without the damping of the bristles: Fc rises towards
 * rest to the breakaway torque. If is_slip, a spring that slips: it loses no energy in presliding. */
typedef struct {
    double Fc, sigma0, F;
    int is_slip;
    double breakaway, stribeck_speed; /* N m, rad/s */
} friction_t;

static inline double friction_limit(const friction_t *f, double speed)
{
    if (f->stribeck_speed <= 0) {
        return f->Fc;
    }
    const double ratio = speed / f->stribeck_speed;
    return f->Fc + (f->breakaway - f->Fc) * exp(-ratio * ratio);
}

/* The integral over a step is exact. Returns the work done against the friction. */
static inline double friction_move(friction_t *f, double dtheta, double speed)
{
    const double sign = dtheta < 0 ? -1 : 1, Fc = friction_limit(f, speed);
    if (f->is_slip) {
        f->F = fmax(-Fc, fmin(Fc, f->F + f->sigma0 * dtheta));
        return f->F * dtheta;
    }
    const double gap = sign * Fc - f->F, closed = -gap * expm1(-f->sigma0 / Fc * fabs(dtheta));
    f->F += closed;
    return sign * Fc * dtheta - sign * closed * Fc / f->sigma0;
}

/* Torque in place of the library's: the naive laws under comparison. */
typedef enum { BY_LIBRARY, BY_NOTHING, BY_TANH } torque_source_t;

/* Position loops. P_PI is a cascade: P of the angle gives the speed that a PI loop tracks. */
typedef enum { FREE, PD, PID, P_PI, LOOPS } loop_t;
#define KP 30.0         /* N m/rad, of PD and PID */
#define KD 0.4          /* N m s/rad, of all loops */
#define KI 300.0        /* N m/(rad s), of PID */
#define CASCADE_KP 50.0 /* 1/s, of the angle */
#define CASCADE_KI 8.0  /* N m/rad, of the speed */

typedef struct {
    friction_t friction;
    double inertia, theta, speed, load; /* rad, rad/s, N m */
    loop_t loop;
    double integral;                    /* N m, of the loop */
    double reference, reference_speed, reference_acceleration;
    double period, theta_per_count;
    int noise, delay; /* counts, ticks */
    int is_noise_after_rounding;
    torque_source_t source;
    double tanh_speed; /* rad/s */
    uint64_t random;
    int32_t last_counts, last_reference_counts;
    double commands[4]; /* the newest first */
    double torque;      /* N m, of the compensator */
    int law, encoder_is_good;
    dahl_compensator_params_t params;
    dahl_compensator_plan_t plan;
    dahl_compensator_t compensator;
    dahl_adaptation_t adaptation;
    dahl_plan_t element;
    dahl_state_t bristle, measured;
} axis_t;

/* An axis whose compensator knows the true friction. */
static inline axis_t axis_of(dahl_compensator_law_t law, int bits, double rate)
{
    axis_t axis;
    memset(&axis, 0, sizeof axis);
    axis.friction = (friction_t){.Fc = TRUE_FC, .sigma0 = TRUE_SIGMA0};
    axis.inertia = 0.002;
    axis.period = 1 / rate;
    axis.theta_per_count = TWO_PI / (1 << bits);
    axis.delay = 1;
    axis.random = 1;
    axis.encoder_is_good = 1;
    axis.params = (dahl_compensator_params_t){
        .friction = {(float)TRUE_SIGMA0, (float)TRUE_FC, (float)axis.theta_per_count},
        .law = law,
        .Fc_low = (float)TRUE_FC,
        .length_long = (float)(TRUE_FC / TRUE_SIGMA0),
        .gain = 0.9f,
        .limit = 1.0f,
        .slew = 50.0f,
        .period = (float)axis.period,
        .fall = 0.02f,
        .play = 1,
        .jump = 1u << 30,
    };
    return axis;
}

/* Bounds that follow the parameters of the element, so that prepare accepts any of them. */
static inline void axis_claim(axis_t *axis, double Fc, double sigma0)
{
    axis->params.friction.Fc = (float)Fc;
    axis->params.friction.sigma0 = (float)sigma0;
    axis->params.Fc_low = axis->params.friction.Fc;
    axis->params.length_long = 0.999f * axis->params.friction.Fc / axis->params.friction.sigma0;
}

static inline void axis_noise(axis_t *axis, int noise)
{
    axis->noise = noise;
    axis->params.noise = (uint32_t)noise;
    axis->params.play = noise > 0 ? 2 * (uint32_t)noise : 1;
}

static inline void axis_start(axis_t *axis)
{
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_prepare(&axis->element, &axis->params.friction));
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_compensator_prepare(&axis->plan, &axis->params));
    axis->law = (int)axis->params.law;
}

/* The noise is uniform in +-noise: of whole counts if it is added after the quantization. */
static inline int32_t axis_read(axis_t *axis)
{
    const uint32_t random = random_u32(&axis->random);
    const double counts = axis->theta / axis->theta_per_count;
    if (axis->is_noise_after_rounding) {
        return (int32_t)floor(counts) + (int32_t)(random % (2 * (uint32_t)axis->noise + 1)) - axis->noise;
    }
    return (int32_t)floor(counts + axis->noise * (random * 0x1p-31 - 1));
}

/* The moves of both laws in one tick; returns the torque of the element in Q30. */
static inline int32_t axis_ratio(axis_t *axis, int32_t dcounts)
{
    int32_t move = dahl_compensator_move(&axis->plan, &axis->compensator, dcounts, axis->encoder_is_good);
    if (axis->law == DAHL_COMPENSATOR_MEASURED) {
        return dahl_step_counts_q30(&axis->element, &axis->bristle, move);
    }
    int32_t counts = (int32_t)floor(axis->reference / axis->theta_per_count);
    int32_t reference_move = counts - axis->last_reference_counts;
    axis->last_reference_counts = counts;
    (void)dahl_step_counts_q30(&axis->element, &axis->measured, move);
    dahl_compensator_pull(&axis->plan, &axis->bristle, &axis->measured);
    return dahl_step_counts_q30(&axis->element, &axis->bristle, reference_move);
}

static inline double axis_compensate(axis_t *axis, int32_t dcounts)
{
    int32_t ratio = dahl_adaptation_apply(&axis->adaptation, axis_ratio(axis, dcounts));
    int32_t torque_q30 = dahl_compensator_torque(&axis->plan, &axis->compensator, ratio);
    switch (axis->source) {
    case BY_NOTHING:
        return 0;
    case BY_TANH:
        return TRUE_FC * axis->params.gain * tanh(dcounts * axis->theta_per_count / axis->period / axis->tanh_speed);
    default:
        return torque_q30 * (double)DAHL_Q30 * axis->params.friction.Fc;
    }
}

/* The loop reads the speed without an error. */
static inline double axis_control(axis_t *axis, double theta, double speed)
{
    const double error = axis->reference - theta, speed_error = axis->reference_speed - speed;
    const double inertial = axis->inertia * axis->reference_acceleration;
    switch (axis->loop) {
    case PD:
        return KP * error + KD * speed_error + inertial;
    case PID:
        axis->integral += KI * error * axis->period;
        return axis->integral + KP * error + KD * speed_error + inertial;
    case P_PI:
        axis->integral += CASCADE_KI * (CASCADE_KP * error + speed_error) * axis->period;
        return axis->integral + KD * (CASCADE_KP * error + speed_error) + inertial;
    default:
        return 0;
    }
}

/* Read the encoder and send a torque; the one of `delay` ticks ago acts now. Returns the motor torque. */
static inline double axis_drive(axis_t *axis)
{
    int32_t counts = axis_read(axis), dcounts = counts - axis->last_counts;
    axis->last_counts = counts;
    axis->torque = axis_compensate(axis, dcounts);
    memmove(&axis->commands[1], &axis->commands[0], 3 * sizeof axis->commands[0]);
    axis->commands[0] = axis->torque + axis_control(axis, counts * axis->theta_per_count, axis->speed);
    return axis->commands[axis->delay];
}

static inline void axis_tick(axis_t *axis, double external)
{
    const double torque = axis_drive(axis) + external - axis->load;
    const int substeps = (int)lround(axis->period / SUBSTEP_S);
    for (int k = 0; k < substeps; k++) {
        axis->speed += (torque - axis->friction.F) / axis->inertia * SUBSTEP_S;
        axis->theta += axis->speed * SUBSTEP_S;
        (void)friction_move(&axis->friction, axis->speed * SUBSTEP_S, axis->speed);
    }
}

/* The hand holds the shaft on a path. Returns the torque of the hand. */
static inline double axis_lead(axis_t *axis, double theta)
{
    const double motor = axis_drive(axis);
    (void)friction_move(&axis->friction, theta - axis->theta, (theta - axis->theta) / axis->period);
    axis->theta = theta;
    return axis->friction.F - motor;
}

static inline void axis_refer(axis_t *axis, double theta, double speed, double acceleration)
{
    axis->reference = theta;
    axis->reference_speed = speed;
    axis->reference_acceleration = acceleration;
}

#endif

/* SPDX-License-Identifier: MIT */
/* A random axis with motor, encoder and position loop, in double precision, to commission. It shares no formula with the
 * library: rotor with Dahl, LuGre or slip elements, gravity, cogging, unequal directions, a wrong torque constant; current
 * lag and delay; encoder with noise and eccentricity; a cascade loop with a wrong inertia. */
#ifndef TEST_RANDOM_AXIS_H
#define TEST_RANDOM_AXIS_H

#include <math.h>
#include <string.h>

#include "../random.h"
#include "dahl_commission.h"

#define TWO_PI 6.283185307179586
#define SUBSTEP 4e-5 /* s */

enum { SLIPS = 6, LATEST = 4 };
typedef enum { AXIS_DAHL, AXIS_LUGRE, AXIS_SLIP } friction_kind_t;

typedef struct {
    friction_kind_t kind;
    double Fc, sigma0, breakaway, stribeck, damping, viscous; /* N m, N m/rad, 1, rad/s, N m s/rad */
    double unequal, ripple, ripple_n, ripple_phase;           /* of Fc */
    double inertia, gravity, gravity_phase, cogging, cogging_n, torque_constant;
    double period, count, lag, noise, eccentric, travel;
    int delay;
    double loop_inertia, loop_hz;
    double load_inertia, shaft, shaft_damping, load_share; /* a second mass with Dahl's friction; 0: a rigid axis */
    /* faults */
    double limit, stop, hand, hand_from, hand_to, freeze_at, sign; /* N m, rad, N m, s */
    uint64_t seed;
} axis_t;

typedef struct {
    double theta, speed, bristle, slip[SLIPS], torque, commands[LATEST];
    double load_theta, load_speed, load_bristle;
    double integral, loop_speed, hand, most_angle, most_speed;
    double time;
    int32_t counts;
    uint8_t mode;
    uint64_t random;
} motion_t;

static inline double uniform(uint64_t *seed, double least, double most)
{
    return least + (most - least) * (random_u32(seed) * 0x1p-32);
}

static inline double log_uniform(uint64_t *seed, double least, double most)
{
    return least * pow(most / least, uniform(seed, 0, 1));
}

/* Neighbouring numbers give independent axes. */
static inline uint64_t seed_of(uint64_t number)
{
    uint64_t bits = (number ^ number >> 30) * UINT64_C(0xBF58476D1CE4E5B9) + UINT64_C(0x9E3779B97F4A7C15);
    bits = (bits ^ bits >> 27) * UINT64_C(0x94D049BB133111EB);
    bits = (bits ^ bits >> 30) * UINT64_C(0xBF58476D1CE4E5B9);
    return bits ^ bits >> 31;
}

static inline axis_t random_axis(uint64_t number)
{
    uint64_t seed = seed_of(number), *s = &seed;
    double kind = uniform(s, 0, 1);
    axis_t axis = {.sign = 1, .period = 1e-3, .loop_hz = 35, .travel = 0.35};
    axis.kind = kind < 0.25 ? AXIS_DAHL : kind < 0.75 ? AXIS_LUGRE : AXIS_SLIP;
    axis.Fc = log_uniform(s, 0.03, 2);
    axis.inertia = axis.Fc / log_uniform(s, 60, 600);
    axis.breakaway = axis.kind == AXIS_LUGRE ? uniform(s, 1, 1.5) : 1;
    axis.stribeck = log_uniform(s, 0.01, 0.1);
    axis.sigma0 = axis.Fc / log_uniform(s, 0.002, 0.015);
    axis.damping = axis.kind == AXIS_LUGRE ? uniform(s, 0.1, 1) * sqrt(axis.sigma0 * axis.inertia) : 0;
    axis.viscous = uniform(s, 0, 0.05) * axis.Fc;
    axis.unequal = uniform(s, -0.15, 0.15);
    axis.ripple = uniform(s, 0, 0.1);
    axis.ripple_n = floor(uniform(s, 1, 13));
    axis.ripple_phase = uniform(s, 0, TWO_PI);
    axis.gravity = uniform(s, 0, 1) < 0.5 ? 0 : uniform(s, 0, 1) * axis.Fc;
    axis.gravity_phase = uniform(s, 0, TWO_PI);
    axis.cogging = uniform(s, 0, 0.15) * axis.Fc;
    axis.cogging_n = floor(uniform(s, 4, 31));
    axis.torque_constant = uniform(s, 0.85, 1.15);
    axis.count = TWO_PI / pow(2, floor(uniform(s, 14, 21)));
    axis.noise = floor(uniform(s, 0, 3));
    axis.eccentric = uniform(s, 0, 0.002);
    axis.delay = 1 + (int)(random_u32(s) >> 31);
    axis.lag = uniform(s, 1e-4, 5e-4);
    axis.loop_inertia = axis.inertia / axis.torque_constant * uniform(s, 0.7, 1.4);
    axis.seed = seed;
    return axis;
}

/* Other encoders, ticks, delays and travels. */
static inline axis_t other_axis(uint64_t number)
{
    axis_t axis = random_axis(number);
    uint64_t seed = axis.seed + 2;
    axis.period = 1e-3 / (1 << (random_u32(&seed) >> 30) % 3);
    axis.count = TWO_PI / pow(2, floor(uniform(&seed, 12, 21)));
    axis.noise = axis.count > 5e-4 ? fmin(axis.noise, 1) : axis.noise;
    axis.delay = 1 + (int)uniform(&seed, 0, 3);
    axis.lag = uniform(&seed, 0.1, 0.5) * axis.period;
    axis.travel = log_uniform(&seed, 0.2, 1.5);
    return axis;
}

/* The same axis with a part of inertia and friction behind a shaft that rings at 30 to 200 Hz. The loop is softer. */
static inline axis_t flexible_axis(uint64_t number)
{
    axis_t axis = random_axis(number);
    uint64_t seed = axis.seed + 1;
    double share = uniform(&seed, 0.2, 0.8), hz = log_uniform(&seed, 30, 200);
    double reduced = axis.inertia * share * (1 - share), w = TWO_PI * hz;
    axis.load_inertia = axis.inertia * share;
    axis.inertia -= axis.load_inertia;
    axis.shaft = reduced * w * w;
    axis.shaft_damping = 2 * uniform(&seed, 0.01, 0.05) * reduced * w;
    axis.load_share = uniform(&seed, 0, 1);
    axis.loop_hz = fmin(35, hz / 5);
    return axis;
}

/* Coulomb torque at an angle and direction, N m of the shaft. */
static inline double coulomb(const axis_t *axis, double theta, double direction)
{
    double ripple = 1 + axis->ripple * sin(axis->ripple_n * theta + axis->ripple_phase);
    return axis->Fc * ripple * (1 + (direction < 0 ? -1 : 1) * axis->unequal);
}

static inline double load_torque(const axis_t *axis, double theta)
{
    return axis->gravity * sin(theta + axis->gravity_phase) + axis->cogging * sin(axis->cogging_n * theta);
}

/* Yields spread over a Dahl curve, so that the first stiffness is near sigma0. */
static inline double slip_torque(const axis_t *axis, motion_t *motion, double moved, double scale)
{
    double sum = 0, x0 = 0, f0 = 0, last = axis->Fc / axis->sigma0 * 3, end = 1 - exp(-3.0);
    double knots[SLIPS], slopes[SLIPS + 1];
    for (int k = 0; k < SLIPS; k++) {
        knots[k] = last * pow(15, (double)(k + 1 - SLIPS) / (SLIPS - 1));
        double force = axis->Fc * (1 - exp(-knots[k] * axis->sigma0 / axis->Fc)) / end;
        slopes[k] = (force - f0) / (knots[k] - x0);
        x0 = knots[k];
        f0 = force;
    }
    slopes[SLIPS] = 0;
    for (int k = 0; k < SLIPS; k++) {
        double stiffness = slopes[k] - slopes[k + 1], yield = stiffness * knots[k] * scale;
        motion->slip[k] = fmax(-yield, fmin(yield, motion->slip[k] + stiffness * moved));
        sum += motion->slip[k];
    }
    return sum;
}

/* Friction after the path of one substep. */
static inline double friction(const axis_t *axis, motion_t *motion, double moved)
{
    double v = motion->speed, limit = coulomb(axis, motion->theta, v), viscous = axis->viscous * v;
    if (axis->kind == AXIS_SLIP) {
        return slip_torque(axis, motion, moved, limit / axis->Fc) + viscous;
    }
    double ratio = v / axis->stribeck, before = motion->bristle;
    limit *= 1 + (axis->breakaway - 1) * exp(-ratio * ratio);
    double goal = (moved > 0) - (moved < 0);
    motion->bristle = limit * goal + (before - limit * goal) * exp(-axis->sigma0 * fabs(moved) / limit);
    double rate = v * (1 - (v < 0 ? -1 : 1) * motion->bristle / limit);
    return motion->bristle + axis->damping * rate + viscous;
}

/* One substep of the second mass. Return the torque of the shaft on the motor. */
static inline double move_load(const axis_t *axis, motion_t *motion, double dt)
{
    double moved = motion->load_speed * dt, limit = axis->load_share * axis->Fc;
    double shaft = axis->shaft * (motion->theta - motion->load_theta)
                   + axis->shaft_damping * (motion->speed - motion->load_speed);
    double goal = limit * ((moved > 0) - (moved < 0));
    motion->load_theta += moved;
    if (limit > 0) {
        double left = exp(-axis->load_share * axis->sigma0 * fabs(moved) / limit);
        motion->load_bristle = goal + (motion->load_bristle - goal) * left;
    }
    motion->load_speed += dt * (shaft - motion->load_bristle - load_torque(axis, motion->load_theta)) / axis->load_inertia;
    return shaft;
}

/* One tick of the shaft under a command. */
static inline void move_shaft(const axis_t *axis, motion_t *motion, double command, double outside)
{
    int substeps = (int)(axis->period / SUBSTEP + 0.5);
    double dt = axis->period / substeps;
    memmove(motion->commands + 1, motion->commands, sizeof motion->commands - sizeof motion->commands[0]);
    motion->commands[0] = command;
    for (int k = 0; k < substeps; k++) {
        motion->torque += (motion->commands[axis->delay] - motion->torque) * (1 - exp(-dt / axis->lag));
        double moved = motion->speed * dt, torque = axis->sign * axis->torque_constant * motion->torque + outside;
        motion->theta += moved;
        double beyond = fabs(motion->theta) - axis->stop;
        if (axis->stop > 0 && beyond > 0) {
            torque -= copysign(200 * axis->Fc * beyond / 0.05, motion->theta) + 0.02 * axis->sigma0 * 0.01 * motion->speed;
        }
        if (axis->load_inertia > 0) {
            torque -= move_load(axis, motion, dt) + (1 - axis->load_share) * friction(axis, motion, moved);
        } else {
            torque -= load_torque(axis, motion->theta) + friction(axis, motion, moved);
        }
        motion->speed += dt * torque / axis->inertia;
    }
    motion->time += axis->period;
}

/* Counts of the encoder. */
static inline int32_t read_encoder(const axis_t *axis, motion_t *motion)
{
    double angle = motion->theta + axis->eccentric * sin(motion->theta);
    double noise = axis->noise * (2 * uniform(&motion->random, 0, 1) - 1);
    return (int32_t)floor(angle / axis->count + noise);
}

/* Cascade of position and speed, with feed-forward of the inertia; it does not wind up. */
static inline double loop_torque(const axis_t *axis, motion_t *motion, const dahl_commission_command_t *to, double last)
{
    const double w = TWO_PI * axis->loop_hz, gain = axis->loop_inertia * w;
    double error = (double)to->angle - motion->counts * axis->count;
    double wanted = w / 5 * error + (double)to->speed - motion->loop_speed;
    if (motion->mode != DAHL_COMMISSION_TRACK) {
        motion->integral = last - gain * wanted;
    }
    double change = gain * w / 6 * wanted * axis->period;
    motion->integral += change;
    double torque = motion->integral + gain * wanted + axis->loop_inertia * (double)to->acceleration;
    if (fabs(torque) > (double)to->torque_limit) {
        motion->integral -= change;
        torque = copysign((double)to->torque_limit, torque);
    }
    return torque;
}

static inline double hand_torque(const axis_t *axis, motion_t *motion)
{
    if (!(axis->hand > 0) || motion->time < axis->hand_from || motion->time > axis->hand_to) {
        return 0;
    }
    motion->hand += (16 * uniform(&motion->random, -1, 1) - motion->hand) * 0.03;
    return axis->hand * motion->hand;
}

static inline void start_motion(const axis_t *axis, motion_t *motion)
{
    *motion = (motion_t){.random = axis->seed};
    for (int k = 0; k < 200; k++) { /* the load settles on the bristles, if it can */
        move_shaft(axis, motion, 0, 0);
        motion->speed *= 0.9;
        motion->load_speed *= 0.9;
    }
    motion->time = 0;
    motion->counts = read_encoder(axis, motion);
}

/* Commission the axis for `seconds` at most. */
static inline dahl_commission_t commission_axis(const axis_t *axis, motion_t *motion, double seconds)
{
    dahl_commission_t state;
    dahl_commission_command_t command;
    double limit = axis->limit > 0 ? axis->limit : 10 * axis->Fc, torque = 0;
    dahl_commission_config_t config = {
        .period = (float)axis->period, .theta_per_count = (float)axis->count, .inertia = (float)axis->loop_inertia,
        .travel = (float)axis->travel, .angle_limit = 2 * (float)axis->travel, .speed_limit = 10, .torque_limit = (float)limit};
    if (dahl_commission_start(&state, &config) != DAHL_COMMISSION_OK) {
        return state;
    }
    start_motion(axis, motion);
    int32_t first = motion->counts, last = first;
    while (motion->time < seconds) {
        int is_frozen = axis->freeze_at > 0 && motion->time > axis->freeze_at;
        int32_t counts = is_frozen ? last : read_encoder(axis, motion), moved = counts - last;
        last = counts;
        motion->counts = counts - first;
        double speed = moved * axis->count / axis->period;
        motion->loop_speed += (speed - motion->loop_speed) * (1 - exp(-TWO_PI * 150 * axis->period));
        if (dahl_commission_tick(&state, moved, (float)torque, &command) >= DAHL_COMMISSION_DONE) {
            break;
        }
        torque = command.mode == DAHL_COMMISSION_TRACK ? loop_torque(axis, motion, &command, torque) : (double)command.torque;
        motion->mode = command.mode;
        move_shaft(axis, motion, torque, hand_torque(axis, motion));
        motion->most_angle = fmax(motion->most_angle, fabs(motion->theta));
        motion->most_speed = fmax(motion->most_speed, fabs(motion->speed));
    }
    return state;
}

/* A compensator on the result of a commissioning. */
typedef struct {
    dahl_plan_t friction;
    dahl_state_t bristle;
    dahl_compensator_plan_t plan;
    dahl_compensator_t compensator;
    float Fc;
} compensation_t;

/* Return 0 if the library rejects the parameters. */
static inline int start_compensation(const dahl_commission_t *state, int has_load, compensation_t *compensation)
{
    dahl_compensator_params_t params;
    *compensation = (compensation_t){0};
    int is_accepted = dahl_commission_params(state, &params, has_load) == DAHL_COMPENSATOR_OK
                      && dahl_prepare(&compensation->friction, &params.friction) == DAHL_OK
                      && dahl_compensator_prepare(&compensation->plan, &params) == DAHL_COMPENSATOR_OK;
    compensation->Fc = params.friction.Fc;
    return is_accepted;
}

static inline double compensate(compensation_t *compensation, int32_t dcounts)
{
    int32_t move = dahl_compensator_move(&compensation->plan, &compensation->compensator, dcounts, 1);
    int32_t ratio = dahl_step_counts_q30(&compensation->friction, &compensation->bristle, move);
    ratio = dahl_compensator_torque(&compensation->plan, &compensation->compensator, ratio);
    return ratio * 0x1p-30 * (double)compensation->Fc;
}

/* Push the axis by `push` N m for 30 ms at most, with compensation on. The push ends at a speed that leaves the axis in its
 * travel. Return its largest speed in the last 0.4 s of 2.5 s. The firmware adds the table of the load, or not: has_load.
 * A state of NULL: without compensation. */
static inline double speed_after_push(const axis_t *axis, const dahl_commission_t *state, int has_load, double push)
{
    compensation_t compensation;
    motion_t motion;
    double most = 0, torque = 0, end_speed = sqrt(0.25 * axis->travel * axis->Fc / axis->inertia);
    int is_pushed = 1;
    if (state != NULL && !start_compensation(state, has_load, &compensation)) {
        return INFINITY;
    }
    start_motion(axis, &motion);
    int32_t first = motion.counts, last = first;
    while (motion.time < 2.5) {
        int32_t counts = read_encoder(axis, &motion), moved = counts - last;
        last = counts;
        torque = state == NULL ? 0 : compensate(&compensation, moved);
        if (state != NULL && !has_load) {
            torque += (double)dahl_commission_load(state, (float)((counts - first) * axis->count));
        }
        is_pushed = is_pushed && motion.time < 0.33 && fabs(motion.speed) < end_speed;
        move_shaft(axis, &motion, torque, motion.time > 0.3 && is_pushed ? push : 0);
        most = motion.time > 2.1 ? fmax(most, fabs(motion.speed)) : 0;
    }
    return most;
}

/* Return the mean torque of a hand that turns the axis to and fro by 0.2 rad, over that without compensation. */
static inline double hand_torque_ratio(const axis_t *axis, const dahl_commission_t *state)
{
    compensation_t compensation;
    motion_t motion;
    double with = 0, without = 0, command = 0;
    if (!start_compensation(state, 0, &compensation)) {
        return INFINITY;
    }
    start_motion(axis, &motion);
    int32_t last = motion.counts;
    for (int tick = 0; tick < 4000; tick++) {
        int32_t counts = read_encoder(axis, &motion);
        double motor = command, angle = 0.2 * sin(tick * axis->period * TWO_PI / 2), moved = angle - motion.theta;
        command = compensate(&compensation, counts - last);
        last = counts;
        motion.speed = moved / axis->period;
        motion.theta = angle;
        double torque = friction(axis, &motion, moved);
        with += tick > 2000 ? fabs(torque - axis->torque_constant * motor) : 0;
        without += tick > 2000 ? fabs(torque) : 0;
    }
    return with / without;
}

#endif

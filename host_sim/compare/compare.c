/* SPDX-License-Identifier: MIT */
#include "compare.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "library_law.h"
#include "../splitmix.h"
#include "../timing.h"

enum { MAX_DELAY = DAHL_RESIDUAL_TICKS };

static const double TWO_PI = 6.283185307179586;
static const double SPEED_FILTER_HZ = 150; /* low-pass of the speed of the loop */

typedef struct {
    double angle, speed, acceleration; /* rad, s */
} target_t;

typedef struct {
    double theta, omega; /* rad, rad/s */
    true_friction_t friction;
    controller_t controller;
    rival_t rival;
    library_law_t library;
    double speed; /* rad/s, of the loop */
    int64_t counts, target_counts;
    uint64_t random;
    double commands[MAX_DELAY]; /* N m, newest first */
} axis_t;

static target_t target_at(const compare_run_t *run, uint32_t tick)
{
    double w = TWO_PI * run->frequency, s = w * fmin(tick, run->motion_ticks) * PERIOD_S;
    target_t target = {.angle = run->amplitude * (sin(s) + run->second * sin(3 * s))};
    if (tick < run->motion_ticks) {
        target.speed = run->amplitude * w * (cos(s) + 3 * run->second * cos(3 * s));
        target.acceleration = -run->amplitude * w * w * (sin(s) + 9 * run->second * sin(3 * s));
    }
    return target;
}

static int64_t counts_of(const compare_run_t *run, double angle, double noise)
{
    double counts = floor(angle / run->law.theta_per_count + noise);
    return (int64_t)counts;
}

static int32_t read_encoder(const compare_run_t *run, axis_t *axis)
{
    double noise = run->law.noise * (2 * splitmix_unit(&axis->random) - 1);
    int64_t before = axis->counts;
    axis->counts = counts_of(run, axis->theta, noise);
    return (int32_t)(axis->counts - before);
}

static reading_t read_all(const compare_run_t *run, axis_t *axis, const target_t *target)
{
    int64_t before = axis->target_counts;
    axis->target_counts = counts_of(run, target->angle, 0);
    reading_t now = {.target_speed = target->speed, .target_move = (int32_t)(axis->target_counts - before),
                     .dcounts = read_encoder(run, axis), .acted = axis->commands[run->law.delay]};
    double measured = now.dcounts * run->law.theta_per_count / PERIOD_S;
    axis->speed += (measured - axis->speed) * (1 - exp(-TWO_PI * SPEED_FILTER_HZ * PERIOD_S));
    now.speed = axis->speed;
    return now;
}

static double loop_torque(const compare_run_t *run, axis_t *axis, const target_t *target)
{
    if (run->law.is_hand) {
        return 0;
    }
    double error = target->angle - (double)axis->counts * run->law.theta_per_count;
    return dahl_controller_torque(&axis->controller, error, (target->speed - axis->speed) * PERIOD_S);
}

static double law_torque(const compare_run_t *run, axis_t *axis, const reading_t *now)
{
    int is_library = run->law.law == DAHL_LAW_DAHL || run->law.law == DAHL_LAW_DAHL_OBSERVER;
    return is_library ? dahl_library_law_torque(&run->law, &axis->library, now) : dahl_rival_torque(&run->law, &axis->rival, now);
}

static void command(const compare_run_t *run, axis_t *axis, double torque)
{
    memmove(axis->commands + 1, axis->commands, sizeof axis->commands - sizeof axis->commands[0]);
    axis->commands[0] = torque;
    if (run->law.law == DAHL_LAW_DAHL_OBSERVER) {
        dahl_library_law_note(&axis->library, torque);
    }
}

/* The friction acts at the middle of each step: half steps in speed around it. */
static void advance(const compare_run_t *run, axis_t *axis, double torque)
{
    double dt = PERIOD_S / run->steps, half = dt / 2 / run->law.inertia;
    for (uint32_t k = 0; k < run->steps; k++) {
        axis->omega += half * (torque - axis->friction.torque);
        axis->theta += dt * axis->omega;
        dahl_true_friction_move(&run->friction, &axis->friction, dt * axis->omega, dt);
        axis->omega += half * (torque - axis->friction.torque);
    }
}

/* A hand that is stiffer than all else moves the axis. */
static void lead(const compare_run_t *run, axis_t *axis, double angle)
{
    double dtheta = angle - axis->theta, dt = PERIOD_S / run->steps;
    for (uint32_t k = 0; k < run->steps; k++) {
        dahl_true_friction_move(&run->friction, &axis->friction, dtheta / run->steps, dt);
    }
    axis->theta += dtheta;
}

/* One tick. Return the torque that a hand feels, or the tracking error of an axis. */
static double move(const compare_run_t *run, axis_t *axis, double torque, double angle)
{
    if (run->law.is_hand) {
        lead(run, axis, angle);
        return axis->friction.torque - torque;
    }
    advance(run, axis, torque);
    return angle - axis->theta;
}

int dahl_compare_run(const compare_run_t *run, const double *learned, double *error, double *motor, double *added,
                     double *feedback)
{
    if (run->law.delay >= MAX_DELAY || run->steps == 0) {
        return DAHL_ERR_RANGE;
    }
    axis_t axis = {.controller = run->controller, .random = run->seed};
    dahl_true_friction_open(&run->friction, &axis.friction);
    int code = dahl_library_law_open(&run->law, &axis.library);
    target_t target, next = target_at(run, 0);
    for (uint32_t tick = 0; code == DAHL_OK && tick < run->ticks; tick++) {
        target = next;
        next = target_at(run, tick + 1);
        reading_t now = read_all(run, &axis, &target);
        now.learned = learned == NULL ? 0 : learned[tick];
        feedback[tick] = loop_torque(run, &axis, &target);
        added[tick] = law_torque(run, &axis, &now);
        command(run, &axis, feedback[tick] + added[tick] + run->law.inertia * target.acceleration * !run->law.is_hand);
        motor[tick] = axis.commands[run->law.delay];
        error[tick] = move(run, &axis, motor[tick], next.angle);
    }
    return code;
}

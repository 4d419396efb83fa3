/* SPDX-License-Identifier: MIT */
/*
 * scene: what runs, read from a small INI file (libinih). A scene names only the parts that it needs: a section that is
 * not there is a part that is not run.
 *
 *   [scene]    title
 *   [friction] the node: model = a name in DAHL_FRAMES_MODELS (dahl_frames.h; default: dahl),
 *              sigma0 [N m/rad], Fc [N m]: of slip and parallel as many numbers as there are elements, 1 to 8;
 *              kinds of parallel: dahl or slip for each; Fc of asymmetric: forward and backward;
 *              breakaway: part of Fc; theta_per_count [rad/count], node (0..15),
 *              timeout_ms (default: the node's own, DAHL_NODE_TIMEOUT_US),
 *              gain (0..1), limit (0..1 of Fc), ramp_ms, max_step [counts/ms]: as in dahl_node.h
 *   [load]     what model = loaded follows, told to the node as parameter Load: min(1, rest + |x|/full), 1 is the load at which
 *              Fc and sigma0 hold. x is the motor's torque [N m] where there is a [rotor], else a column of the log;
 *              full [unit of x], rest (0..1, part without x, default 0), column
 *   [motion]   the encoder: kind = segments | steering | log, start_count, and
 *              segments: theta1 theta2 theta3 [counts], speed [counts/s], hold_s
 *              steering: amplitude [counts], sweep_s, hold_s, tremor [counts], tremor_s, seconds
 *              log:      file, angle (column), time (column), counts_per_unit
 *   [rotor]    a shaft that reacts: inertia [kg m^2], viscous [N m s/rad], its true sigma0 and Fc; driven by one of
 *   [motor]    a torque over time: bias, amplitude [N m], frequency [Hz], seconds
 *   [control]  that follows [motion] with the node's help: kp [N m/rad], kd [N m s/rad], torque_limit [N m]
 *   [faults]   what happens to the encoder's frames, as parts of all of them: drop, duplicate, ... (faults.h)
 *   [status]   Status frames of the node: period_ms
 *   [measured] for the plots only; nothing in it is looked at here
 */
#ifndef SCENE_H
#define SCENE_H

#include <stdbool.h>
#include <stdint.h>

#include "dahl_frames.h"
#include "dahl_parts.h"
#include "faults.h"

#define SCENE_TEXT 160u

typedef enum { MOTION_SEGMENTS = 1, MOTION_STEERING = 2, MOTION_LOG = 4 } motion_kind_t;

typedef struct {
    uint32_t count;
    double value[DAHL_SLIP_MAX];
} scene_list_t;

#define SCENE_MODEL(name, NAME, ...) MODEL_##NAME,
typedef enum { DAHL_FRAMES_MODELS(SCENE_MODEL) } scene_model_t;

typedef struct {
    char model_name[SCENE_TEXT], kinds[SCENE_TEXT];
    scene_model_t model;
    uint32_t slips;                /* of parallel: bit k where element k slips */
    scene_list_t sigma0_of, Fc_of; /* one an element; of asymmetric one sigma0, and Fc forward and backward */
    double sigma0, Fc;             /* what the ratio on the bus is of: their sums, the larger Fc */
    double breakaway;
    double theta_per_count, node, timeout_ms;
    double gain, limit, ramp_ms, max_step;
} scene_friction_t;

typedef struct {
    double inertia, viscous, sigma0, Fc;
} scene_rotor_t;

typedef struct {
    double bias, amplitude, frequency, seconds;
} scene_motor_t;

typedef struct {
    double kp, kd, torque_limit;
} scene_control_t;

typedef struct {
    double full, rest;
    char column[SCENE_TEXT];
} scene_load_t;

typedef struct {
    motion_kind_t kind;
    char kind_name[SCENE_TEXT];
    double start_count;
    double theta1, theta2, theta3, speed;
    double hold_s;
    double amplitude, sweep_s, tremor, tremor_s, seconds;
    char file[SCENE_TEXT], angle[SCENE_TEXT], time[SCENE_TEXT];
    double counts_per_unit;
} scene_motion_t;

typedef struct {
    bool has_friction, has_motion, has_status, has_rotor, has_motor, has_control, has_faults, has_load;
    char title[SCENE_TEXT];
    scene_friction_t friction;
    scene_load_t load;
    scene_motion_t motion;
    scene_rotor_t rotor;
    scene_motor_t motor;
    scene_control_t control;
    double faults[FAULT_KINDS]; /* rates */
    double status_period_ms;
} scene_t;

/* sets: count texts "section.key=value" that stand above the file. False: one error line was printed, naming file, line
 * and key. */
bool scene_read(scene_t *scene, const char *path, const char *const *sets, int count);

#endif

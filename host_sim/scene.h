/* SPDX-License-Identifier: MIT */
/*
 * scene: read a scene file (INI, by libinih). scene_keys.def lists its sections and keys with ranges, units and defaults. A
 * part of the loop runs only if its section is there. Of section [measured] only the keys are checked.
 */
#ifndef SCENE_H
#define SCENE_H

#include <stdbool.h>
#include <stdint.h>

#include "dahl_frames.h"
#include "dahl_parts.h"
#include "faults.h"
#include "rotor.h"

#include "scene_keys.def" /* SCENE_TEXT */

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
    uint32_t slips;                /* of parallel: bit k is set if element k slips */
    scene_list_t sigma0_of, Fc_of; /* of each element, or one sigma0 and Fc forward, backward */
    double sigma0, Fc;             /* of the ratio on the bus: the sums, or the larger Fc of two directions */
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
    double full, rest, rotor_limit;
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
    bool has_friction, has_motion, has_status, has_rotor, has_motor, has_control, has_faults, has_load, has_hand;
    char title[SCENE_TEXT];
    scene_friction_t friction;
    scene_load_t load;
    scene_motion_t motion;
    scene_rotor_t rotor;
    scene_motor_t motor;
    scene_control_t control;
    hand_t hand;
    double faults[FAULT_KINDS]; /* rates */
    double status_period_ms;
} scene_t;

/* sets: texts "section.key=value" that override the file. False: one error line with file, line and key was printed. */
bool scene_read(scene_t *scene, const char *path, const char *const *sets, int count);

#endif

/* SPDX-License-Identifier: MIT */
/*
 * run_file: read the parameters of a run: one line "section.key = value" for each key, in any order. keys.csv lists the keys
 * with types, ranges, units and defaults. A comment begins with # or ; at the start of a line or after a blank. A part of the
 * loop runs only if a key of its section is there.
 */
#ifndef RUN_FILE_H
#define RUN_FILE_H

#include <stdbool.h>
#include <stdint.h>

#include "dahl_frames.h"
#include "dahl_parts.h"
#include "faults.h"
#include "rotor.h"

#define RUN_TEXT 1024u /* bytes of a text, with its final 0 */

typedef enum { MOTION_SEGMENTS = 1, MOTION_STEERING = 2, MOTION_COUNTS = 4 } motion_kind_t;

typedef struct {
    uint32_t count;
    double value[DAHL_SLIP_MAX];
} run_list_t;

#define RUN_MODEL(name, NAME, ...) MODEL_##NAME,
typedef enum { DAHL_MODELS(RUN_MODEL) RUN_MODELS } run_model_t;

typedef struct {
    char model[RUN_TEXT], kinds[RUN_TEXT];
    run_list_t sigma0, Fc; /* of each element, or one sigma0 and Fc forward, backward */
    double own; /* value of the own key of the model, if that is a number */
    double theta_per_count, node, timeout_ms;
    double gain, limit, ramp_ms, max_step;
    /* derived from the keys */
    run_model_t number;
    uint32_t slips; /* of parallel: bit k is set if element k slips */
} run_friction_t;

typedef struct {
    double inertia, viscous, sigma0, Fc;
} run_rotor_t;

typedef struct {
    double bias, amplitude, frequency, seconds;
} run_motor_t;

typedef struct {
    double kp, kd, torque_limit;
} run_control_t;

typedef struct {
    double full, rest, rotor_limit;
} run_load_t;

typedef struct {
    char kind[RUN_TEXT], file[RUN_TEXT];
    double start_count;
    double theta1, theta2, theta3, speed;
    double hold_s;
    double amplitude, sweep_s, tremor, tremor_s, seconds;
    motion_kind_t number; /* of the kind */
} run_motion_t;

typedef struct {
    double period_ms;
} run_status_t;

typedef struct {
    bool has_friction, has_load, has_motion, has_rotor, has_motor, has_control, has_hand, has_faults, has_status;
    run_friction_t friction;
    run_load_t load;
    run_motion_t motion;
    run_rotor_t rotor;
    run_motor_t motor;
    run_control_t control;
    hand_t hand;
    double faults[FAULT_KINDS]; /* rates */
    run_status_t status;
} run_t;

/* False: one error line with file, line and key was printed. */
bool run_file_read(run_t *run, const char *path);

#endif

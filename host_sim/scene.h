/* SPDX-License-Identifier: MIT */
/*
 * scene: what runs, read from a small INI file (libinih). A scene names only the parts that it needs: a section that is
 * not there is a part that is not run.
 *
 *   [scene]    title
 *   [friction] the node: sigma0 [N m/rad], Fc [N m], theta_per_count [rad/count], node (0..15),
 *              timeout_ms (default 1000: a desk computer may stall; NODE_TIMEOUT_US of firmware is shorter)
 *   [motion]   the encoder: kind = segments | steering | log, start_count, and
 *              segments: theta1 theta2 theta3 [counts], speed [counts/s], hold_s
 *              steering: amplitude [counts], sweep_s, hold_s, tremor [counts], tremor_s, seconds
 *              log:      file, angle (column), time (column), counts_per_unit
 *   [status]   Status frames of the node: period_ms
 *   [measured] for the plots only; nothing in it is looked at here
 */
#ifndef SCENE_H
#define SCENE_H

#include <stdbool.h>
#include <stdint.h>

#define SCENE_TEXT 160u

typedef enum { MOTION_SEGMENTS = 1, MOTION_STEERING = 2, MOTION_LOG = 4 } motion_kind_t;

typedef struct {
    double sigma0, Fc, theta_per_count, node, timeout_ms;
} scene_friction_t;

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
    bool has_friction, has_motion, has_status;
    char title[SCENE_TEXT];
    scene_friction_t friction;
    scene_motion_t motion;
    double status_period_ms;
} scene_t;

/* False: one error line was printed, naming file, line and key. */
bool scene_read(scene_t *scene, const char *path);

#endif

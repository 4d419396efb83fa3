/* SPDX-License-Identifier: MIT */
/*
 * compare: run one law of friction compensation on a simulated axis: with a position loop, or led by a hand along a path.
 * tools/dahl/sim/compensation_axis.py calls it, so it is in libdahl.so and has its prefix.
 *
 * Motion: amplitude (sin s + second sin(3 s)), s = 2 pi frequency t, up to motion_ticks; then it holds its last angle.
 * Encoder: floor(angle/theta_per_count + noise u), u uniform within -1 and 1. The loop takes angle and speed from it.
 */
#ifndef COMPARE_H
#define COMPARE_H

#include "../controller.h"
#include "rivals.h"
#include "true_friction.h"

typedef struct {
    law_params_t law;
    true_friction_params_t friction;
    controller_t controller;
    double amplitude, frequency, second;   /* rad, Hz, 1 */
    uint32_t motion_ticks, ticks;          /* of the motion, of motion and hold */
    uint32_t steps;                        /* of the integration in a tick, at least 1 */
    uint64_t seed;
} compare_run_t;

/* Run all ticks. learned: N m for each tick, or NULL. Write for each tick: the tracking error in rad, or the torque of the hand in
 * N m; the torque of the motor; of it, that of the law; and that of the loop. Return 0, or the code of a refused parameter. */
int dahl_compare_run(const compare_run_t *run, const double *learned, double *error, double *motor, double *added,
                     double *feedback);

#endif

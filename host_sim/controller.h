/* SPDX-License-Identifier: MIT */
/*
 * controller: the torque of a position loop, once each period:
 *   PD       kp, kd
 *   PID      kp, kd, ki
 *   cascade  a P loop of the angle with gain p around a PI loop of the speed with gains d and i:
 *            kp = p d, kd = d, ki = p i, ki_speed = i
 *
 * Python calls it too (tools/dahl/sim/compensation.py), so it is in libdahl.so and has its prefix.
 */
#ifndef CONTROLLER_H
#define CONTROLLER_H

typedef struct {
    double kp;       /* N m/rad */
    double kd;       /* N m s/rad */
    double ki;       /* N m/(rad s) */
    double ki_speed; /* N m/rad */
    double integral; /* N m; 0 at the start */
} controller_t;

/* N m. error: reference minus angle, rad. change: of the error in a period, rad. For counts, multiply the result by rad/count. */
double dahl_controller_torque(controller_t *controller, double error, double change);

#endif

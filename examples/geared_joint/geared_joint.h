/* SPDX-License-Identifier: MIT */
#ifndef GEARED_JOINT_H
#define GEARED_JOINT_H

#include "../position_loop/position_loop.h"

/* A joint behind a gear. Values with `joint` are at its output side. */
typedef struct {
    float ratio;             /* turns of the motor in one turn of the joint; negative if they turn against each other */
    float Fc_joint;          /* N m */
    float sigma0_joint;      /* N m/rad */
    float inertia_joint;     /* kg m2, the lightest load */
    float inertia_motor;     /* kg m2, rotor and input of the gear */
    float motor_rad_per_count, joint_rad_per_count;
} geared_joint_params_t;

typedef struct {
    geared_joint_params_t params;
    position_loop_params_t motor; /* all at the motor */
    position_loop_t loop;
    int32_t reference; /* counts of the motor */
    float measured;    /* rad of the joint */
} geared_joint_t;

/* Reference of a tick, at the joint: rad, rad/s, rad/s2, N m of gravity. */
typedef struct {
    float angle, speed, acceleration, gravity;
} geared_joint_reference_t;

/* Readings: counts of the motor since its last good reading, counts of the joint from its zero. */
typedef struct {
    int32_t motor_dcounts, joint_count;
    int motor_is_good, joint_is_good;
} geared_joint_readings_t;

/* Start at this count of the joint. `motor` has the parameters that do not follow from the joint: gain, limits, period, gains
 * of the loop. Friction, inertia and angles are filled in. Returns 0, or a code of position_loop_init(): leave the motor off. */
int geared_joint_init(geared_joint_t *joint, const geared_joint_params_t *params, const position_loop_params_t *motor,
                      int32_t joint_count);

/* Return the torque of the motor in N m. */
float geared_joint_tick(geared_joint_t *joint, const geared_joint_reference_t *reference,
                        const geared_joint_readings_t *readings);

#endif

/* SPDX-License-Identifier: MIT */
/*
 * A joint behind a gear, with an encoder on each side; the README of this folder explains the choice.
 * - The encoder of the motor feeds the compensator, the observer and the speed loop: the torque acts there, without the delay
 *   and the play of the gear.
 * - The encoder of the joint feeds the position loop and gravity: it sees where the load is.
 */
#include "geared_joint.h"

#include <math.h>

/* Convert friction and inertia to the motor: torque over N, angle times N, so stiffness and inertia over N^2. */
static void fill(position_loop_params_t *motor, const geared_joint_params_t *joint)
{
    float N = fabsf(joint->ratio);
    motor->compensator.friction.Fc = joint->Fc_joint / N;
    motor->compensator.friction.sigma0 = joint->sigma0_joint / (N * N);
    motor->compensator.friction.theta_per_count = joint->motor_rad_per_count;
    motor->observer.inertia = joint->inertia_motor + joint->inertia_joint / (N * N);
    motor->compensator.law = DAHL_COMPENSATOR_REFERENCE;
}

static int32_t motor_counts(const geared_joint_params_t *params, float angle)
{
    return (int32_t)lrintf(angle * params->ratio / params->motor_rad_per_count);
}

int geared_joint_init(geared_joint_t *joint, const geared_joint_params_t *params, const position_loop_params_t *motor,
                      int32_t joint_count)
{
    joint->params = *params;
    joint->motor = *motor;
    fill(&joint->motor, params);
    int code = position_loop_init(&joint->loop, &joint->motor);
    if (code == 0) {
        joint->measured = (float)joint_count * params->joint_rad_per_count;
        joint->reference = motor_counts(params, joint->measured);
    }
    return code;
}

float geared_joint_tick(geared_joint_t *joint, const geared_joint_reference_t *reference,
                        const geared_joint_readings_t *readings)
{
    float N = joint->params.ratio;
    if (readings->joint_is_good) {
        joint->measured = (float)readings->joint_count * joint->params.joint_rad_per_count;
    }
    int32_t before = joint->reference;
    joint->reference = motor_counts(&joint->params, reference->angle);
    position_loop_reference_t motor = {joint->reference - before, N * reference->speed, N * reference->acceleration,
                                       reference->gravity / N};
    float error = N * (reference->angle - joint->measured);
    return position_loop_torque(&joint->loop, &motor, error, readings->motor_dcounts, readings->motor_is_good);
}

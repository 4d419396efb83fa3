/* SPDX-License-Identifier: MIT */
#ifndef POSITION_LOOP_H
#define POSITION_LOOP_H

#include <dahl_compensator.h>

/* Parameters of an axis. The loop takes inertia and speed_gain from the observer, period and angles from the compensator. */
typedef struct {
    dahl_compensator_params_t compensator; /* law: DAHL_COMPENSATOR_REFERENCE */
    dahl_residual_params_t observer;
    float position_gain; /* 1/s */
    float integral_time; /* s, of the speed loop */
    float drive_limit;   /* N m */
} position_loop_params_t;

/* Reference of a tick. */
typedef struct {
    int32_t dcounts;    /* counts since the last tick */
    float speed;        /* rad/s */
    float acceleration; /* rad/s2 */
    float known;        /* N m to feed forward besides friction and inertia: gravity, viscous friction */
} position_loop_reference_t;

typedef struct {
    const position_loop_params_t *params;
    dahl_plan_t friction;
    dahl_state_t bristle;
    dahl_compensator_plan_t plan;
    dahl_compensator_t compensator;
    dahl_residual_plan_t residual_plan;
    dahl_residual_t residual;
    int32_t error;  /* counts: reference less shaft */
    uint32_t ticks; /* since the last good reading */
    float speed;    /* rad/s, measured; held while readings are bad */
    float integral; /* N m */
} position_loop_t;

/* Start an axis that rests at its reference. params must stay. Returns 0, or a code of dahl_prepare(),
 * dahl_compensator_prepare() or dahl_residual_prepare(): leave the motor off. */
int position_loop_init(position_loop_t *loop, const position_loop_params_t *params);

/* Return the torque of the motor in N m. dcounts: counts of the encoder since the last good reading. is_good = 0: the reading
 * is bad and dcounts is not used. Close the brake if this lasts. */
float position_loop_tick(position_loop_t *loop, const position_loop_reference_t *reference, int32_t dcounts, int is_good);

/* The same for an error that another encoder measures: reference less shaft, in rad of the motor. */
float position_loop_torque(position_loop_t *loop, const position_loop_reference_t *reference, float error, int32_t dcounts,
                           int is_good);

#endif

/* SPDX-License-Identifier: MIT */
/* An axis that measures its own friction, then cancels it. Its drive needs an encoder and a torque command, nothing else. */
#ifndef AXIS_H
#define AXIS_H

#include <dahl_commission.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    dahl_commission_t commission; /* also has the table of the load */
    dahl_commission_command_t command;
    float kp, kd, ki, speed_share;         /* position loop */
    float angle, speed, integral, torque;  /* rad from the start, rad/s, N m; torque of the last tick */
    int32_t counts;
    dahl_plan_t friction;
    dahl_state_t bristle;
    dahl_compensator_plan_t plan;
    dahl_compensator_t compensator;
    float Fc;             /* N m, of the compensator */
    int is_compensating;  /* 0 while it commissions, and after a refusal: command.refusal */
} axis_t;

/* Start to commission. The axis rests in the middle of its travel. loop_hz: bandwidth of the position loop, such as 35; at most
 * 0.035 / period. */
dahl_commission_refusal_t axis_start(axis_t *axis, const dahl_commission_config_t *config, float loop_hz);

/* Return the torque in N m. Call it once in a tick, after the encoder is read. is_good: 0 for a bad reading. After the
 * commissioning, the torque cancels friction and load: add that of your own loop. After a refusal it is 0. */
float axis_tick(axis_t *axis, int32_t dcounts, int is_good);

#ifdef __cplusplus
}
#endif

#endif

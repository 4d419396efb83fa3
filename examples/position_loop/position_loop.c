/* SPDX-License-Identifier: MIT */
/*
 * The position loop of an axis: P of the position, PI of the speed, feed-forward of speed and acceleration. The friction that
 * the reference will meet is fed forward, too (reference law), and the residual observer adds what this model lacks. Call the
 * tick in a timer interrupt.
 */
#include "position_loop.h"

#include <string.h>

int position_loop_init(position_loop_t *loop, const position_loop_params_t *params)
{
    memset(loop, 0, sizeof *loop);
    loop->params = params;
    int code = dahl_prepare(&loop->friction, &params->compensator.friction);
    code = code != DAHL_OK ? code : dahl_compensator_prepare(&loop->plan, &params->compensator);
    return code != DAHL_OK ? code : dahl_residual_prepare(&loop->residual_plan, &params->compensator, &params->observer);
}

static float clamp(float x, float limit)
{
    return x > limit ? limit : x < -limit ? -limit : x;
}

static void measure_speed(position_loop_t *loop, int32_t dcounts, int is_good)
{
    const dahl_compensator_params_t *p = &loop->params->compensator;
    loop->ticks++;
    if (is_good) {
        loop->speed = (float)dcounts * p->friction.theta_per_count / ((float)loop->ticks * p->period);
        loop->ticks = 0;
    }
}

/* Return the torque of the loop in N m: P of the position, then PI of the speed. */
static float control(position_loop_t *loop, float wanted_speed, float error)
{
    const position_loop_params_t *p = loop->params;
    float speed_error = wanted_speed + p->position_gain * error - loop->speed;
    loop->integral += p->observer.speed_gain * speed_error * p->compensator.period / p->integral_time;
    loop->integral = clamp(loop->integral, p->drive_limit);
    return p->observer.speed_gain * speed_error + loop->integral;
}

float position_loop_tick(position_loop_t *loop, const position_loop_reference_t *reference, int32_t dcounts, int is_good)
{
    loop->error += reference->dcounts - (is_good ? dcounts : 0);
    float error = (float)loop->error * loop->params->compensator.friction.theta_per_count;
    return position_loop_torque(loop, reference, error, dcounts, is_good);
}

float position_loop_torque(position_loop_t *loop, const position_loop_reference_t *reference, float error, int32_t dcounts,
                           int is_good)
{
    const position_loop_params_t *p = loop->params;
    float unit = p->compensator.friction.Fc * DAHL_Q30;
    measure_speed(loop, dcounts, is_good);
    (void)dahl_compensator_move(&loop->plan, &loop->compensator, dcounts, is_good); /* faults and fades */
    int32_t w = dahl_step_counts_q30(&loop->friction, &loop->bristle, reference->dcounts);
    float friction = unit * (float)dahl_compensator_torque(&loop->plan, &loop->compensator, w);
    float residual = unit * (float)dahl_residual_torque(&loop->residual_plan, &loop->residual, &loop->compensator, dcounts);

    float known = friction + reference->known;
    float command = control(loop, reference->speed, error) + known;
    command = clamp(command + p->observer.inertia * reference->acceleration + residual, p->drive_limit);
    dahl_residual_note(&loop->residual, dahl_residual_q24(&loop->residual_plan, command - known));
    return command;
}

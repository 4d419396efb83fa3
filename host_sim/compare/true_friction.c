/* SPDX-License-Identifier: MIT */
#include "true_friction.h"

#include <math.h>

static const double MAXWELL_LENGTHS = 3; /* presliding lengths, after which all elements slip */

/* The elements break one by one at equal distances. Between two of them the slope is that of Dahl's curve, scaled to end at Fc. */
static void open_maxwell(const true_friction_params_t *params, true_friction_t *friction)
{
    double distance = MAXWELL_LENGTHS / MAXWELL_ELEMENTS, scale = 1 / (1 - exp(-MAXWELL_LENGTHS));
    for (int k = 0; k < MAXWELL_ELEMENTS; k++) {
        double end = distance * (k + 1); /* presliding lengths */
        double slope = (exp(distance - end) - exp(-end)) / distance;
        double next = k + 1 < MAXWELL_ELEMENTS ? slope * exp(-distance) : 0;
        friction->stiffnesses[k] = params->sigma0 * scale * (slope - next);
        friction->limits[k] = friction->stiffnesses[k] * end * params->Fc / params->sigma0;
    }
}

void dahl_true_friction_open(const true_friction_params_t *params, true_friction_t *friction)
{
    *friction = (true_friction_t){0};
    open_maxwell(params, friction);
}

static double move_maxwell(true_friction_t *friction, double dtheta)
{
    double sum = 0;
    for (int k = 0; k < MAXWELL_ELEMENTS; k++) {
        double limit = friction->limits[k], force = friction->forces[k] + friction->stiffnesses[k] * dtheta;
        friction->forces[k] = fmax(-limit, fmin(limit, force));
        sum += friction->forces[k];
    }
    return sum;
}

static double move_lugre(const true_friction_params_t *params, true_friction_t *friction, double dtheta, double dt)
{
    double speed = dtheta / dt, ratio = speed / params->stribeck;
    double sliding = params->Fc + (params->breakaway - params->Fc) * exp(-ratio * ratio);
    double end = copysign(sliding / params->sigma0, dtheta), before = friction->deflection;
    friction->deflection = end + (before - end) * exp(-params->sigma0 / sliding * fabs(dtheta));
    return params->sigma0 * friction->deflection + params->sigma1 * (friction->deflection - before) / dt;
}

void dahl_true_friction_move(const true_friction_params_t *params, true_friction_t *friction, double dtheta, double dt)
{
    double end = copysign(params->Fc, dtheta);
    switch (params->kind) {
    case DAHL_TRUE_LUGRE:
        friction->torque = move_lugre(params, friction, dtheta, dt);
        break;
    case DAHL_TRUE_MAXWELL:
        friction->torque = move_maxwell(friction, dtheta);
        break;
    case DAHL_TRUE_DAHL:
    default:
        friction->torque = end + (friction->torque - end) * exp(-params->sigma0 / params->Fc * fabs(dtheta));
        break;
    }
}

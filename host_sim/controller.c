/* SPDX-License-Identifier: MIT */
#include "controller.h"

#include "timing.h"

double dahl_controller_torque(controller_t *controller, double error, double change)
{
    controller->integral += controller->ki * error * PERIOD_S + controller->ki_speed * change;
    return controller->integral + controller->kp * error + controller->kd * change / PERIOD_S;
}

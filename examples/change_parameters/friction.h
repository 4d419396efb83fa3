/* SPDX-License-Identifier: MIT */
/* Friction of one bearing whose parameters may change while an interrupt steps it. */
#ifndef FRICTION_H
#define FRICTION_H

#include <stdbool.h>

#include <dahl.h>

/* From main: take these parameters from the next tick on. False while the last ones wait for their tick, or with an error of
 * dahl_prepare in *err; then nothing has changed. Before the first tick it gives the parameters to begin with. */
bool friction_set(const dahl_params_t *params, dahl_err_t *err);

/* From main: the plan that the ticks use, to be prepared again with the parameters that it has. */
dahl_plan_t *friction_plan(void);

/* From the interrupt: the shaft has moved by dcounts; the torque F in N m. */
float friction_tick(int32_t dcounts);

#endif

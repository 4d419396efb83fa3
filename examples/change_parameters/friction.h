/* SPDX-License-Identifier: MIT */
/* Friction of a bearing. Its parameters may change while an interrupt steps it. */
#ifndef FRICTION_H
#define FRICTION_H

#include <stdbool.h>

#include <dahl.h>

/* From main: use these parameters from the next tick on, or from the first tick. Returns false and changes nothing if the last
 * parameters still wait for a tick, or if dahl_prepare fails with *err. */
bool friction_set(const dahl_params_t *params, dahl_err_t *err);

/* From main: the plan that the ticks use, for example to prepare it again with the same parameters. */
dahl_plan_t *friction_plan(void);

/* From the interrupt: the torque F in N m after a move by dcounts. */
float friction_tick(int32_t dcounts);

#endif

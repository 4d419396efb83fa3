/* SPDX-License-Identifier: MIT */
/* Friction compensation whose parameters may change while an interrupt runs it. */
#ifndef COMPENSATION_H
#define COMPENSATION_H

#include <stdbool.h>

#include <dahl_compensator.h>

/* From main: use these parameters from the next tick on, or from the first tick. Returns false and changes nothing if the last
 * parameters still wait for a tick, or if a prepare function fails with *code. The law must stay. */
bool compensation_set(const dahl_compensator_params_t *params, int *code);

/* From the interrupt: the torque in N m to add to the command after a move by dcounts; is_good: false for a bad reading. */
float compensation_tick(int32_t dcounts, bool is_good);

#endif

/* SPDX-License-Identifier: MIT */
/*
 * One axis of a drive, and the work of its interrupt in each tick: from the reading of the 16-bit timer to the sum of the
 * controller's torque and the friction. In N m, or without a float in units of the drive.
 */
#ifndef AXIS_H
#define AXIS_H

#include "dahl.h"
#include "dahl_encoder.h"

typedef struct {
    dahl_encoder_t encoder;
    dahl_state_t bearing;
    float asked; /* N m */
    int32_t asked_units;
    uint32_t Fc_units;
} axis_t;

float axis_tick(const dahl_plan_t *plan, axis_t *axis, uint32_t reading);
int32_t axis_tick_units(const dahl_plan_t *plan, axis_t *axis, uint32_t reading);

/* bench_call with the type of both */
float call_axis(const dahl_plan_t *, axis_t *, uint32_t) __asm__("bench_call");

#endif

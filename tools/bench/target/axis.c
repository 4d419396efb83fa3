/* SPDX-License-Identifier: MIT */
/* See axis.h. */
#include "axis.h"

int32_t axis_tick_units(const dahl_plan_t *plan, axis_t *axis, uint32_t reading)
{
    int32_t ratio = dahl_step_counts_q30(plan, &axis->bearing, dahl_encoder_move(&axis->encoder, reading));
    return dahl_to_units(ratio, axis->Fc_units) + axis->asked_units;
}

float axis_tick(const dahl_plan_t *plan, axis_t *axis, uint32_t reading)
{
    float F = dahl_step_counts(plan, &axis->bearing, dahl_encoder_move(&axis->encoder, reading));
    return F + axis->asked;
}

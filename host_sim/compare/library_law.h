/* SPDX-License-Identifier: MIT */
/* library_law: the laws of dahl_compensator.h, called as its header says. Knob of the residual observer: its corner in Hz. */
#ifndef LIBRARY_LAW_H
#define LIBRARY_LAW_H

#include "dahl_compensator.h"
#include "rivals.h"

#define LIBRARY_LIMIT 1.0f /* N m */
#define LIBRARY_SLEW 50.0f /* N m/s */

typedef struct {
    dahl_plan_t friction;
    dahl_state_t bristle;
    dahl_compensator_plan_t plan;
    dahl_compensator_t compensator;
    dahl_residual_plan_t residual_plan;
    dahl_residual_t residual;
    float Fc;
    float known; /* N m, of the model in this tick */
} library_law_t;

/* Return 0, or the error code of the prepare function that refuses the parameters. */
int dahl_library_law_open(const law_params_t *law, library_law_t *library);

/* Return the torque in N m to add to the command. Then call dahl_library_law_note() with the command. */
double dahl_library_law_torque(const law_params_t *law, library_law_t *library, const reading_t *now);

void dahl_library_law_note(library_law_t *library, double command);

#endif

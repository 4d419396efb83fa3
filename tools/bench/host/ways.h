/* SPDX-License-Identifier: MIT */
/* All methods under one contract: moves in counts in, F/Fc or torques out. */
#ifndef WAYS_H
#define WAYS_H

#include <stddef.h>
#include <stdint.h>

#include "dahl_float.h"
#include "dahl_batch.h"
#include "dahl.h"
#include "rivals.h"

/* Parameters and state of one run, for any method. */
typedef struct {
    dahl_params_t params;
    dahl_plan_t plan;
    dahl_state_t state;
    rival_plan_t rival_plan;
    rival_state_t rival_state;
    double a, w; /* of the method in double */
} run_t;

typedef struct {
    const char *name;
    /* Run n moves. Results are F/Fc in double, so that the bench adds no rounding; angles are moves times theta per count. */
    void (*ratios)(run_t *run, const int32_t *dcounts, const float *angles, double *w, size_t n);
    int by_angle;
    /* The timed form: torques in N m. */
    void (*torques)(run_t *run, const int32_t *dcounts, const float *angles, float *F, size_t n);
} way_t;

extern const way_t ways[];
extern const size_t ways_count;

const way_t *way_named(const char *name);
void start_run(run_t *run, const dahl_params_t *params, int32_t substeps);

#endif

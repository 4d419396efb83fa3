/* SPDX-License-Identifier: MIT */
/* All methods to compute the torque, with one interface: moves in counts in, torques F/Fc out. */
#ifndef WAYS_H
#define WAYS_H

#include <stddef.h>
#include <stdint.h>

#include "dahl_float.h"
#include "dahl_batch.h"
#include "dahl.h"
#include "rivals.h"

/* Parameters and state of one run, for all methods. */
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
    /* n moves; torques F/Fc in double, so that no rounding of the bench is added; angles are moves times theta per count */
    void (*ratios)(run_t *run, const int32_t *dcounts, const float *angles, double *w, size_t n);
    int by_angle;
    /* as in a user's program, torques in N m: this one is timed */
    void (*torques)(run_t *run, const int32_t *dcounts, const float *angles, float *F, size_t n);
} way_t;

/* vector_exp.c: at most VECTOR_BLOCK ticks; w gets F/Fc. sleef_block() exists if HAS_SLEEF is defined. */
enum { VECTOR_BLOCK = 512 };
void vector_exp_block(run_t *run, const int32_t *dcounts, double *w, size_t n);
void sleef_block(run_t *run, const int32_t *dcounts, double *w, size_t n);

extern const way_t ways[];
extern const size_t ways_count;

const way_t *way_named(const char *name);
void start_run(run_t *run, const dahl_params_t *params, int32_t substeps);

#endif

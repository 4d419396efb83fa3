/* SPDX-License-Identifier: MIT */
/* A friction element whose model is chosen at run time. */
#ifndef FMU_ELEMENT_H
#define FMU_ELEMENT_H

#include "dahl_frames.h"
#include "dahl_parts.h"

/* Value references; tools/dahl/sim/fmu.py has the same. */
enum {
    FMU_ANGLE = 0,                       /* [rad] input */
    FMU_LOAD = 1,                        /* input of the model loaded */
    FMU_TORQUE = 2,                      /* [N m] output */
    FMU_RATIO = 3,                       /* output, torque over the largest torque at load 1 */
    FMU_THETA = 4,                       /* [rad] theta_per_count; 0: moves by angle */
    FMU_BREAKAWAY = 5,                   /* [Fc] of the model elastoplastic */
    FMU_SIGMA0 = 6,                      /* [N m/rad] of each element */
    FMU_FC = FMU_SIGMA0 + DAHL_SLIP_MAX, /* [N m] of each element, or of each direction */
    FMU_VALUES = FMU_FC + DAHL_SLIP_MAX
};

/* Model, names, limits and start values, fixed when the FMU is exported. */
typedef struct {
    char mark[16];            /* tools/dahl/sim/fmu.py finds this block in the shared object by it */
    char guid[40];            /* that of modelDescription.xml */
    char model[16];           /* name in DAHL_FRAMES_MODELS */
    uint32_t sigma0s;         /* numbers of sigma0 */
    uint32_t Fcs;             /* numbers of Fc */
    uint32_t slips;           /* of the model parallel: bit k is set if element k slips */
    uint32_t fixed_stiffness; /* of the model loaded: 1 if only Fc follows the load */
    struct {
        char name[16]; /* "" if the model has no such variable */
        double start;
        double low;  /* low <= value */
        double high; /* value < high */
    } variable[FMU_VALUES];
} fmu_start_t;

#define FMU_PLAN(name, ...) dahl_##name##_plan_t name;
typedef struct {
    const fmu_start_t *start;
    uint32_t model;
    double largest_torque; /* [N m] at load 1 */
    union {
        dahl_plan_t dahl[DAHL_SLIP_MAX]; /* of dahl, loaded and parallel */
        dahl_elastoplastic_plan_t elastoplastic;
        DAHL_FRAMES_DIRECTED_MODELS(FMU_PLAN)
    } plan;
    dahl_slip_plan_t slip[DAHL_SLIP_MAX]; /* of slip and parallel */
} fmu_element_t;

/* All zeros: relaxed. */
typedef struct {
    dahl_loaded_state_t bristle[DAHL_SLIP_MAX];
    dahl_slip_state_t slip[DAHL_SLIP_MAX];
} fmu_state_t;

/* Prepare the element from values by value reference. DAHL_ERR_PARAM if the model is unknown. */
dahl_err_t fmu_prepare(fmu_element_t *element, const fmu_start_t *start, const double *value);

/* Move by counts, or by an angle [rad] if theta_per_count is 0. Returns the torque [N m]. */
float fmu_move(const fmu_element_t *element, fmu_state_t *state, double distance, double theta_per_count, uint32_t load_q30);

#endif

/* SPDX-License-Identifier: MIT */
/* Variables of an FMU: value references, names, limits and start values. */
#ifndef FMU_VARIABLES_H
#define FMU_VARIABLES_H

#include "dahl_parts.h"

/* Value references; tools/dahl/simulators/fmu.py has the same. */
enum {
    FMU_ANGLE = 0,                       /* [rad] input */
    FMU_LOAD = 1,                        /* input of the model loaded */
    FMU_TORQUE = 2,                      /* [N m] output */
    FMU_RATIO = 3,                       /* output, torque over the largest torque at load 1 */
    FMU_THETA = 4,                       /* [rad] theta_per_count; 0: moves by angle */
    FMU_OWN = 5,                         /* the number of the model's own key */
    FMU_SIGMA0 = 6,                      /* [N m/rad] of each element */
    FMU_FC = FMU_SIGMA0 + DAHL_SLIP_MAX, /* [N m] of each element, or of each direction */
    FMU_TIME = FMU_FC + DAHL_SLIP_MAX,   /* [s] of FMI 3.0 */
    FMU_SIGMA1 = FMU_TIME + 1,           /* [N m s/rad] presliding damping; 0: none */
    FMU_VALUES = FMU_SIGMA1 + 1
};

/* Model, names, limits and start values, fixed when the FMU is exported. */
typedef struct {
    char mark[16];            /* tools/dahl/simulators/fmu.py finds this block in the shared object by it */
    char guid[40];            /* that of modelDescription.xml */
    char model[16];           /* name in DAHL_MODELS */
    uint32_t sigma0s, Fcs;    /* numbers of sigma0 and Fc */
    uint32_t slips;           /* of the model parallel: bit k is set if element k slips */
    uint32_t fixed_stiffness; /* of the model loaded: 1 if only Fc follows the load */
    struct {
        char name[16]; /* "" if the model has no such variable */
        double start;
        double low;  /* low <= value */
        double high; /* value < high */
    } variable[FMU_VALUES];
} fmu_start_t;

#endif

/* SPDX-License-Identifier: MIT */
/* friction: any friction model, chosen by its name at run time. The plugin of MuJoCo and the FMU use it. It calls no libm. */
#ifndef FRICTION_H
#define FRICTION_H

#include <stdbool.h>

#include "dahl_frames.h"
#include "dahl_parts.h"

#define FRICTION_ENUM(name, NAME, ...) FRICTION_##NAME,
enum { DAHL_FRAMES_MODELS(FRICTION_ENUM) FRICTION_MODELS };

typedef struct {
    const char *name;
    uint32_t sigma0s, Fcs; /* numbers of sigma0 and Fc; 0: one for each element */
} friction_model_t;
extern const friction_model_t friction_models[FRICTION_MODELS];

#define FRICTION_PLAN(name, ...) dahl_##name##_plan_t name;
typedef union {
    dahl_plan_t dahl; /* also of loaded */
    dahl_slip_plan_t slip;
    dahl_elastoplastic_plan_t elastoplastic;
    DAHL_FRAMES_DIRECTED_MODELS(FRICTION_PLAN)
} friction_plan_t;

/* Set the members above Fc, then call friction_prepare(). */
typedef struct {
    uint32_t model;            /* FRICTION_... */
    dahl_slip_params_t params; /* of any model: sigma0 and Fc of each element or direction; elements is the number of Fc */
    float breakaway;           /* [Fc] of elastoplastic */
    uint32_t slips;            /* of parallel: bit k is set if element k slips, else it is a Dahl element */
    bool is_stiffness_fixed;   /* of loaded: sigma0 does not follow the load, and moves are by angle */
    double Fc;                 /* [N m] torque at a ratio of 1: the sum, or the larger one of two directions */
    friction_plan_t plan[DAHL_SLIP_MAX]; /* of each part; only parallel has more than one */
    int32_t share[DAHL_SLIP_MAX];        /* of each part of parallel */
} friction_t;

#define FRICTION_STATE_WORDS DAHL_SLIP_MAX /* those of dahl_slip_state_t, the larger state */

/* State of one part. Any bits are safe; all zeros are relaxed. */
typedef union {
    dahl_loaded_state_t bristle; /* of all but slip elements */
    dahl_slip_state_t slip;
    uint32_t word[FRICTION_STATE_WORDS]; /* all bits, to save and restore them */
} friction_state_t;

/* Return FRICTION_..., or FRICTION_MODELS if there is no such model. */
uint32_t friction_find(const char *name);

/* Prepare the model. If theta_per_count is 0, dahl moves by angle. Another model gets a fine count, 2^-20 of the least
 * presliding length Fc/sigma0, so that a count changes F by at most 1e-6 of Fc. Return the error of the library. */
dahl_err_t friction_prepare(friction_t *f);

/* Return the length of the array of states: one state for each part. */
uint32_t friction_count_states(const friction_t *f);

/* Return the position at an angle: the nearest count, or the angle itself if the model moves by angle. */
double friction_position(const friction_t *f, double angle);

/* Move by a difference of positions under a load, 0 <= load < 2, and return F [N m]. Only loaded reads the load. */
float friction_move(const friction_t *f, friction_state_t *state, double distance, double load);

/* Move in the same way by counts and return F over the member Fc, in Q30. */
int32_t friction_move_q30(const friction_t *f, friction_state_t *state, double counts, double load);

#endif

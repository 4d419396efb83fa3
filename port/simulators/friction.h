/* SPDX-License-Identifier: MIT */
/* friction: any friction model, chosen by its name at run time. The plugin of MuJoCo and the FMU use it. It calls no libm. */
#ifndef FRICTION_H
#define FRICTION_H

#include <stdbool.h>

#include "dahl_parts.h"

#define FRICTION_ENUM(name, NAME, ...) FRICTION_##NAME,
enum { DAHL_MODELS(FRICTION_ENUM) FRICTION_MODELS };

typedef struct {
    const char *name, *key; /* key: its own; "" if there is none */
    double low, high;       /* of the key if it is a number, the member `own` of the parameters; otherwise 0 */
    const dahl_model_t *calls;
} friction_model_t;
extern const friction_model_t friction_models[FRICTION_MODELS];

/* Set the members above Fc, then call friction_prepare(). */
typedef struct {
    uint32_t model;             /* FRICTION_... */
    dahl_model_params_t params; /* `elements` is the number of Fc */
    bool is_stiffness_fixed;    /* of loaded: sigma0 does not follow the load, and moves are by angle */
    double Fc;                  /* [N m] torque at a ratio of 1: the sum, or the larger one of two directions */
    double sigma0;              /* [N m/rad] stiffness at rest, the sum */
    dahl_any_plan_t plan;
} friction_t;

#define FRICTION_STATE_WORDS (sizeof(dahl_any_state_t) / sizeof(uint32_t))

/* All zeros are relaxed. */
typedef union {
    dahl_any_state_t any;
    uint32_t word[FRICTION_STATE_WORDS]; /* all bits, to save and restore them */
} friction_state_t;

/* Return FRICTION_..., or FRICTION_MODELS if there is no such model. */
uint32_t friction_find(const char *name);

/* Prepare the model. If theta_per_count is 0, dahl moves by angle. Another model gets a fine count, 2^-20 of the least
 * presliding length Fc/sigma0, so that a count changes F by at most 1e-6 of Fc. Return the error of the library. */
dahl_err_t friction_prepare(friction_t *f);

/* Return how many words of the state the model uses. */
uint32_t friction_count_words(const friction_t *f);

/* Return the position at an angle: the nearest count, or the angle itself if the model moves by angle. */
double friction_position(const friction_t *f, double angle);

/* Move by a difference of positions under a load, 0 <= load < 2, and return F [N m]. Only loaded reads the load. */
float friction_move(const friction_t *f, friction_state_t *state, double distance, double load);

/* Move in the same way by counts and return F over the member Fc, in Q30. */
int32_t friction_move_q30(const friction_t *f, friction_state_t *state, double counts, double load);

#endif

/* SPDX-License-Identifier: MIT */
/* friction: any friction model of a node, chosen by its name, without a bus. */
#ifndef FRICTION_H
#define FRICTION_H

#include <stddef.h>

#include "dahl_node.h"

#define FRICTION_STORAGE(name, ...) dahl_node_##name##_t name;

struct friction_model;

/* A model and its state. Set the first members, then call friction_prepare. */
typedef struct {
    const struct friction_model *model;
    dahl_slip_params_t params; /* of any model: sigma0 and Fc of each element or direction; elements is the number of Fc */
    uint32_t sigma0s;          /* number of sigma0 */
    uint32_t slips;            /* of parallel: bit k is set if element k slips */
    float breakaway;           /* [Fc] of elastoplastic */
    double Fc;                 /* [N m] torque at a ratio of 1 */
    dahl_node_t node;          /* node.plan and node.bearing are the Dahl element; node.model is any other model */
    union {
        DAHL_FRAMES_OTHER_MODELS(FRICTION_STORAGE)
    } storage; /* of node.model */
} friction_t;

/* One row of DAHL_FRAMES_MODELS. */
typedef struct friction_model {
    const char *name;
    uint32_t sigma0s, Fcs; /* numbers of sigma0 and Fc; 0: one for each element */
    dahl_err_t (*use)(friction_t *f);
    size_t state, state_size; /* [byte] place of the state in friction_t */
} friction_model_t;

/* Return the model with this name, or NULL. */
const friction_model_t *friction_find(const char *name);

/* Prepare the model, relaxed. If theta_per_count is 0, the model dahl moves by angle; another model gets a fine count, 2^-20 of
 * the least presliding length Fc/sigma0, so that a count changes F by at most 1e-6 of Fc. Return the error of the library. */
dahl_err_t friction_prepare(friction_t *f);

/* Return the position at an angle: the nearest count, or the angle itself if the model moves by angle. */
double friction_position(const friction_t *f, double angle);

/* Move by a difference of positions and return F [N m]. Only the model loaded reads the load, 0 to 1. */
double friction_move(friction_t *f, double move, double load);

/* The state as whole numbers, a word of 32 bits each: their number, save and restore. Any numbers are a safe state. */
int friction_words(friction_t *f);
void friction_save(friction_t *f, double *words);
void friction_restore(friction_t *f, const double *words);

#endif

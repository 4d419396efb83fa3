/* SPDX-License-Identifier: MIT */
/* attributes: the parameters of an instance of dahl.friction, from its config elements in the model. */
#ifndef ATTRIBUTES_H
#define ATTRIBUTES_H

#include <mujoco/mujoco.h>

#include "../simulators/friction.h"


typedef struct {
    friction_t friction;
    int joint, tendon; /* id; -1: none */
    int slot;          /* of dahl.friction among the plugins of MuJoCo */
    float full, rest;  /* of loaded: the load is rest + |torque of the actuators|/full */
    float dampratio;   /* of the presliding damping; 1: critical */
} instance_t;

/* Write the names of all attributes, and return their number. */
enum { ATTRIBUTES_MAX = 9 + FRICTION_MODELS };
int attributes_list(const char *names[ATTRIBUTES_MAX]);

/* Return the model, FRICTION_...; FRICTION_MODELS if its name is wrong. */
uint32_t attributes_read_model(const mjModel *m, int instance);

/* Read and check all attributes, and prepare the friction. For a bad attribute, free d and call mju_error(), which names the
 * instance, the attribute, its value and its limit, and does not return. MuJoCo then rejects the model. So this function must own
 * no memory. */
void attributes_read(const mjModel *m, mjData *d, int instance, instance_t *self);

#endif

/* SPDX-License-Identifier: MIT */
/* models: configure a node for the friction model that a scene names. */
#ifndef MODELS_H
#define MODELS_H

#include "dahl_node.h"
#include "scene.h"

/* Plan and state of any model but dahl, which the node itself holds. */
typedef union {
    dahl_node_slip_t slip;
    dahl_node_parallel_t parallel;
    dahl_node_asymmetric_t asymmetric;
    dahl_node_elastoplastic_t elastoplastic;
    dahl_node_loaded_t loaded;
} model_storage_t;

/* Call it after dahl_node_init. Returns the library's code. */
dahl_err_t models_use(dahl_node_t *node, model_storage_t *storage, const scene_friction_t *friction);

#endif

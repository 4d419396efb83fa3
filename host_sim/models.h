/* SPDX-License-Identifier: MIT */
/* models: a node made to answer by the model that a scene names. */
#ifndef MODELS_H
#define MODELS_H

#include "dahl_node.h"
#include "scene.h"

/* What a node keeps for any model but Dahl's own. */
#define MODEL_STORAGE(name, ...) dahl_node_##name##_t name;
typedef union {
    DAHL_FRAMES_OTHER_MODELS(MODEL_STORAGE)
} models_kept_t;

/* After dahl_node_init. The library's code. */
dahl_err_t models_use(dahl_node_t *node, models_kept_t *kept, const scene_friction_t *friction);

#endif

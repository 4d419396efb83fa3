/* SPDX-License-Identifier: MIT */
/* models: initialize a node with the friction model of a run file. */
#ifndef MODELS_H
#define MODELS_H

#include "dahl_node.h"
#include "run_file.h"

/* Memory of a node for a model other than dahl; each member begins with a dahl_node_model_t. */
#define MODEL_STORAGE(name, ...) dahl_node_##name##_t name;
typedef union {
    DAHL_OTHER_MODELS(MODEL_STORAGE)
} model_memory_t;

/* path: of the run file. Returns 0, or prints one error line and returns -1. */
int models_start(dahl_node_t *node, model_memory_t *memory, const run_friction_t *f, uint8_t number, const char *path);

#endif

/* SPDX-License-Identifier: MIT */
/* models: set the friction model of a node from a run file. */
#ifndef MODELS_H
#define MODELS_H

#include "dahl_node.h"
#include "run_file.h"

/* Memory of a node for a model other than dahl; each member begins with a dahl_node_model_t. */
#define MODEL_STORAGE(name, ...) dahl_node_##name##_t name;
typedef union {
    DAHL_OTHER_MODELS(MODEL_STORAGE)
} model_memory_t;

/* Call it after dahl_node_init. It returns the error code of the library. */
dahl_err_t models_use(dahl_node_t *node, model_memory_t *memory, const run_friction_t *f);

#endif

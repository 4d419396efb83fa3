/* SPDX-License-Identifier: MIT */
/** Common part of the dahl_node_use_... calls. */
#ifndef DAHL_NODE_USE_MODEL_H
#define DAHL_NODE_USE_MODEL_H

#include "dahl_node.h"

/** Answer with this model from now on. A client reads params. */
static inline void dahl_node_use(dahl_node_t *node, dahl_node_model_t *model, const dahl_params_t *params)
{
    node->model = model;
    node->params = *params;
    node->held = *params;
}

#endif

/* SPDX-License-Identifier: MIT */
/* What every model in place of the Dahl element does when a node takes it, private. */
#ifndef DAHL_NODE_USE_MODEL_H
#define DAHL_NODE_USE_MODEL_H

#include "dahl_node.h"

/* Answer by this model from now on; params are what a client reads. */
static inline void dahl_node_use(dahl_node_t *node, dahl_node_model_t *model, const dahl_params_t *params)
{
    node->model = model;
    node->params = *params;
    node->held = *params;
}

#endif

/* SPDX-License-Identifier: MIT */
/** Plan and state of the model that answers. */
#ifndef DAHL_NODE_MODEL_STORAGE_H
#define DAHL_NODE_MODEL_STORAGE_H

#include "dahl_node.h"

/** Return the plan that follows a dahl_node_model_t in dahl_node_NAME_t; its state follows the plan. Both need the
 * alignment of 64 bits at most, which the sizes of dahl_node_model_t and of each plan are multiples of. */
static inline void *dahl_node_plan(dahl_node_model_t *model)
{
    return model + 1;
}

static inline void *dahl_node_state(dahl_node_model_t *model)
{
    return (char *)(model + 1) + model->calls->plan_bytes;
}

/** All zeros are relaxed. */
static inline void dahl_node_relax(dahl_node_model_t *model)
{
    uint8_t *bytes = (uint8_t *)dahl_node_state(model);
    for (uint32_t k = 0; k < model->calls->state_bytes; k++) {
        bytes[k] = 0;
    }
}

#endif

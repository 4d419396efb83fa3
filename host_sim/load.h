/* SPDX-License-Identifier: MIT */
/* load: the load of a bearing in the unit of parameter Load. */
#ifndef LOAD_H
#define LOAD_H

#include <math.h>

#include "dahl_node.h"
#include "run_file.h"

/* min(limit, rest + |x|/full), in units of 1/DAHL_NODE_ONE; x in the unit of full. */
static inline uint32_t load_of(const run_load_t *load, double x, double limit)
{
    return (uint32_t)lround(fmin(limit, load->rest + fabs(x) / load->full) * DAHL_NODE_ONE);
}

#endif

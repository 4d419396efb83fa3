/* SPDX-License-Identifier: MIT */
/*
 * counters: write the results of a run, one line "name = value" each; times in ns. Only parts that were run have lines. A
 * histogram is its maximum, then upper edge:count for each bin with counts. tools/dahl/sim/run_file.py makes the summary of it.
 */
#ifndef COUNTERS_H
#define COUNTERS_H

#include "loop.h"
#include "plant.h"

/* plant: NULL without a controller. path "-": stdout. False: errno has the reason. */
bool counters_write(const char *path, const loop_t *loop, const plant_t *plant);

#endif

/* SPDX-License-Identifier: MIT */
/* summary: what a run came to, as JSON (cJSON). */
#ifndef SUMMARY_H
#define SUMMARY_H

#include <stdbool.h>

#include "loop.h"
#include "options.h"
#include "plant.h"
#include "scene.h"

/* Write to a file, or "-" for stdout. plant: NULL where nothing was controlled. False: errno says why. */
bool summary_write(const char *path, const options_t *options, const scene_t *scene, const loop_t *loop,
                   const plant_t *plant);

#endif

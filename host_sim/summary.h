/* SPDX-License-Identifier: MIT */
/* summary: the results of a run as JSON (cJSON). */
#ifndef SUMMARY_H
#define SUMMARY_H

#include <stdbool.h>

#include "loop.h"
#include "options.h"
#include "plant.h"
#include "scene.h"

/* Write to a file, or to stdout if path is "-". plant: NULL without a [control]. Returns false with errno set on failure. */
bool summary_write(const char *path, const options_t *options, const scene_t *scene, const loop_t *loop,
                   const plant_t *plant);

#endif

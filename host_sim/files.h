/* SPDX-License-Identifier: MIT */
/* files: find the files of a run, and ensure that no output overwrites an input or another output. */
#ifndef FILES_H
#define FILES_H

#include "options.h"
#include "scene.h"

#define FILES_PATH 1024u

/* Find the scene's measured log: --log-file, or [motion] file in --data DIR, or else in the folder of the scene file; "" if the
 * scene has no log. Returns 0, or -1 after one error line: the path is too long. */
int files_find_log(char path[FILES_PATH], const options_t *options, const scene_t *scene);

/* Returns 0, or -1 after one error line: an output is also an input or another output. */
int files_check(const options_t *options, const char *measured_log);

#endif

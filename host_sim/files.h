/* SPDX-License-Identifier: MIT */
/* files: what a run reads and what it writes, and that it writes over nothing that it needs. */
#ifndef FILES_H
#define FILES_H

#include "options.h"
#include "scene.h"

#define FILES_PATH 1024u

/* Where the scene's measured log is: as --log-file says, or in --data DIR, or beside the scene file; "" where the scene
 * has none. 0, or -1 after one error line was printed: the path is too long. */
int files_find_log(char path[FILES_PATH], const options_t *options, const scene_t *scene);

/* 0, or -1 after one error line was printed: a file to write is one that is read, or that is written for another purpose. */
int files_check(const options_t *options, const char *measured_log);

#endif

/* SPDX-License-Identifier: MIT */
/* files: find the file of counts, and ensure that no output overwrites an input or another output. */
#ifndef FILES_H
#define FILES_H

#include "options.h"

#define FILES_PATH 2048u

/* Join the folder of the run file and the name of the file of counts. Returns 0, or -1 after one error line: too long. */
int files_find_counts(char path[FILES_PATH], const char *run_file, const char *counts);

/* counts: "" if no file is read. Returns 0, or -1 after one error line: an output is also an input or another output. */
int files_check(const options_t *options, const char *counts);

#endif

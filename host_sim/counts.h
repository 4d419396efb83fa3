/* SPDX-License-Identifier: MIT */
/*
 * counts: read a motion from a file: one line for each tick, the encoder's count and, if the friction has a load, its x. The
 * file is read row by row, so that memory does not grow with it; it may be a pipe.
 */
#ifndef COUNTS_H
#define COUNTS_H

#include "lines.h"

/* Return 1 with the next count and x, 0 if the line has none; 0 at the end; -1 after one error line. */
int counts_next(lines_t *lines, int32_t *count, double *x);

#endif

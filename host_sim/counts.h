/* SPDX-License-Identifier: MIT */
/*
 * counts: read a motion from a file: one line for each tick, the encoder's count and, if the friction has a load, its x. The
 * file is read row by row, so that memory does not grow with it; it may be a pipe.
 */
#ifndef COUNTS_H
#define COUNTS_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

typedef struct {
    FILE *file;
    const char *path; /* must stay valid */
    uint64_t line;
    char *text; /* of the present line */
    size_t room;
} counts_t;

/* False: one error line was printed. */
bool counts_open(counts_t *self, const char *path);

/* Return 1 with the next count and x, 0 if the line has none; 0 at the end; -1 after one error line. */
int counts_next(counts_t *self, int32_t *count, double *x);

void counts_close(counts_t *self);

#endif

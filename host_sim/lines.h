/* SPDX-License-Identifier: MIT */
/* lines: read a file that people or programs write, line by line in fixed memory. It may be a pipe. */
#ifndef LINES_H
#define LINES_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#define LINES_BYTES 4096u /* of a line, with its end */

typedef struct {
    const char *path; /* must stay valid */
    FILE *file;
    uint64_t line; /* number of the present one, from 1 */
    char text[LINES_BYTES];
} lines_t;

/* False: one error line was printed. */
bool lines_open(lines_t *self, const char *path);

/* Read the next line into text, without its newline. Return 1; 0 at the end; -1 after one error line with file and line. */
int lines_next(lines_t *self);

void lines_close(lines_t *self);

#endif

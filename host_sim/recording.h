/* SPDX-License-Identifier: MIT */
/*
 * recording: one column of a measured log as encoder counts, read as a stream (libcsv), so that memory does not grow with
 * the file: count = round(value*counts_per_unit - that of the first row). A column of the load beside it is read as it stands.
 * Text with a header line; columns parted by tabs, semicolons or commas, whichever the header has, in this order.
 * The file is read twice: first whole, so that a bad row is known before the first frame is sent, then row by row.
 */
#ifndef RECORDING_H
#define RECORDING_H

#include <csv.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#define RECORDING_CHUNK 4096u /* bytes read at a time; no row is shorter than 2, so no chunk has more rows */

typedef struct {
    FILE *file;
    const char *path; /* this and the names must outlive the recording */
    const char *angle_name;
    const char *time_name; /* "": none */
    const char *load_name; /* "": none */
    double counts_per_unit;
    struct csv_parser parser;
    bool parser_ready;
    bool failed;
    bool ended;
    uint64_t line;
    uint64_t rows;
    size_t columns; /* of the header; 0 before it */
    size_t column;  /* in the present row */
    size_t angle_column, time_column, load_column;
    double angle, time, load, last_time;
    double first; /* counts of the first row, before rounding */
    char header[256]; /* for the error that names the columns there are */
    size_t head, tail;
    int32_t counts[RECORDING_CHUNK];
    double loads[RECORDING_CHUNK]; /* 0 where there is no such column */
} recording_t;

/* What to read; "": no such column. */
typedef struct {
    const char *angle, *time, *load;
    double counts_per_unit;
} recording_columns_t;

/* Check the whole file and go back to its start. False: one error line was printed, naming file, line and column. */
bool recording_open(recording_t *self, const char *path, const recording_columns_t *columns);

/* The next count and its load: 1; the end: 0; an error, printed: -1. */
int recording_next(recording_t *self, int32_t *count, double *load);

void recording_close(recording_t *self);

#endif

/* SPDX-License-Identifier: MIT */
/*
 * recording: read the angle column of a measured log as encoder counts, as a stream (libcsv), so that memory does not grow with
 * the file: count = round(value*counts_per_unit - that of the first row). A column of the load is read without a scale.
 * The file has a header line. The separator is the first of tab, semicolon and comma that the header contains.
 * The file is read twice: once to find a bad row before the first frame is sent, then row by row.
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
    const char *path; /* path and names must stay valid */
    const char *angle_name;
    const char *time_name; /* "": not read */
    const char *load_name; /* "": not read */
    double counts_per_unit;
    struct csv_parser parser;
    bool is_parser_ready;
    bool has_failed;
    bool has_ended;
    uint64_t line;
    uint64_t rows;
    size_t columns; /* of the header; 0 before it */
    size_t column;  /* of the present row */
    size_t angle_column, time_column, load_column;
    double angle, time, load, last_time;
    double first; /* counts of the first row, before rounding */
    char header[256]; /* names of all columns, for an error message */
    size_t head, tail;
    int32_t counts[RECORDING_CHUNK];
    double loads[RECORDING_CHUNK]; /* 0 without a column of the load */
} recording_t;

/* Columns to read; "": not read. */
typedef struct {
    const char *angle, *time, *load;
    double counts_per_unit;
} recording_columns_t;

/* Check the whole file and return to its start. False: one error line with file, line and column was printed. */
bool recording_open(recording_t *self, const char *path, const recording_columns_t *columns);

/* Return 1 with the next count and load; 0 at the end; -1 after one error line. */
int recording_next(recording_t *self, int32_t *count, double *load);

void recording_close(recording_t *self);

#endif

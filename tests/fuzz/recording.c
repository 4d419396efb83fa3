/* SPDX-License-Identifier: MIT */
/*
 * Measured logs, any bytes: refused with one line, or read twice with the same rows, each of which fits 32 bits. Text
 * without quotes is read a second time here, line by line.
 */
#include "recording.h"

#include <math.h>

#include "streams.h"

enum { ROWS_MAX = 1024, FIELDS_MAX = 64 };

typedef struct {
    int rows; /* -1: refused */
    int32_t counts[ROWS_MAX];
} rows_t;

static void read_all(rows_t *rows, double counts_per_unit, const char *time)
{
    static recording_t recording;
    const recording_columns_t columns = {"a", time, time, counts_per_unit};
    double load = 0;
    int good = recording_open(&recording, "log", &columns);
    rows->rows = good ? 0 : -1;
    if (good) {
        int32_t count;
        int result;
        while ((result = recording_next(&recording, &count, &load)) == 1) {
            LAW(rows->rows > 0 || count == 0, "counts begin at 0");
            LAW(time[0] == '\0' ? load == 0 : isfinite(load), "a load is a finite number, and 0 where there is none");
            if (rows->rows < ROWS_MAX) {
                rows->counts[rows->rows++] = count;
            }
        }
        LAW(result == 0 && recording_next(&recording, &count, &load) == 0, "what was checked is read without an error, to its end");
        LAW(rows->rows > 0, "a log without rows is refused");
    }
    recording_close(&recording);
    streams_check(good);
}

/* Fields of a line, blanks around them taken off; the line is cut up. */
static int split(char *line, char delimiter, char *fields[FIELDS_MAX])
{
    int count = 0;
    for (char *at = line; at != NULL && count < FIELDS_MAX; count++) {
        char *end = strchr(at, delimiter);
        if (end != NULL) {
            *end++ = '\0';
        }
        fields[count] = at + strspn(at, " ");
        for (size_t i = strlen(fields[count]); i > 0 && fields[count][i - 1] == ' '; i--) {
            fields[count][i - 1] = '\0';
        }
        at = end;
    }
    return count;
}

static int is_finite_number(const char *text, double *value)
{
    char *end;
    *value = strtod(text, &end);
    return end != text && *end == '\0' && isfinite(*value);
}

/* One row after the header; 0: it is refused. */
static int read_row(rows_t *rows, char *fields[FIELDS_MAX], int count, int columns, int angle, double scale)
{
    static double first;
    double value;
    if (count != columns || !is_finite_number(fields[angle], &value)) {
        return 0;
    }
    first = rows->rows == 0 ? value * scale : first;
    if (!(fabs(value * scale - first) < 2147483647.0)) {
        return 0;
    }
    rows->counts[rows->rows++] = (int32_t)lround(value * scale - first);
    return 1;
}

static int find(char *fields[FIELDS_MAX], int count)
{
    int found = -1;
    for (int i = 0; i < count; i++) {
        if (strcmp(fields[i], "a") == 0) {
            if (found >= 0) {
                return -1;
            }
            found = i;
        }
    }
    return found;
}

typedef struct {
    char delimiter;
    int columns; /* of the header; 0 before it */
    int angle;   /* which; -1: refused */
    double scale;
} layout_t;

static void read_line(rows_t *rows, layout_t *layout, char *line)
{
    char *fields[FIELDS_MAX];
    int count = split(line, layout->delimiter, fields);
    if (layout->columns == 0) {
        layout->columns = count;
        layout->angle = find(fields, count);
    } else if (layout->angle >= 0 && !read_row(rows, fields, count, layout->columns, layout->angle, layout->scale)) {
        layout->angle = -1;
    }
}

/* Plain text only. 0: blanks alone stand in a line, and what that is, is for libcsv to say. */
static int read_again(rows_t *rows, char *text, double scale)
{
    layout_t layout = {memchr(text, ';', strcspn(text, "\n")) ? ';' : ',', 0, 0, scale};
    char *end;
    rows->rows = 0;
    for (char *line = text; line != NULL; line = end) {
        end = strchr(line, '\n');
        if (end != NULL) {
            *end++ = '\0';
        }
        if (line[0] == '\0') {
            continue;
        }
        if (line[strspn(line, " ")] == '\0') {
            return 0;
        }
        read_line(rows, &layout, line);
    }
    rows->rows = layout.angle < 0 || rows->rows == 0 ? -1 : rows->rows;
    return 1;
}

/* No quotes, no CR, no 0, no tabs, not more fields than fit. */
static int is_plain(const uint8_t *data, size_t size)
{
    size_t separators = 0;
    for (size_t i = 0; i < size; i++) {
        separators += data[i] == ',' || data[i] == ';';
        if (memchr("\"\r\0\xEF\v\f\t", data[i], 7) != NULL) {
            return 0;
        }
    }
    return separators < FIELDS_MAX - 1;
}

static void compare(const uint8_t *data, size_t size, double scale, const rows_t *rows)
{
    static rows_t again;
    static char text[8192];
    if (size >= sizeof text || rows->rows == ROWS_MAX || !is_plain(data, size)) {
        return;
    }
    memcpy(text, data, size);
    text[size] = '\0';
    if (read_again(&again, text, scale)) {
        LAW(again.rows == rows->rows, "refused iff a second reader refuses, with as many rows");
        LAW(rows->rows < 0 || memcmp(again.counts, rows->counts, (size_t)rows->rows * sizeof rows->counts[0]) == 0,
            "rows are what a second reader reads");
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const double scales[4] = {1, 1e3, -1e15, 0.25};
    static rows_t rows;
    if (size < 2) {
        return 0;
    }
    double scale = scales[data[0] & 3];
    int timed = data[0] & 4;
    streams_begin(data + 1, size - 1);
    read_all(&rows, scale, timed ? "t" : "");
    if (!timed) {
        compare(data + 1, size - 1, scale, &rows);
    }
    return 0;
}

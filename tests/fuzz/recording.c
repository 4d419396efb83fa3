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
    int good = recording_open(&recording, "log", "a", time, counts_per_unit);
    rows->rows = good ? 0 : -1;
    if (good) {
        int32_t count;
        int result;
        while ((result = recording_next(&recording, &count)) == 1) {
            LAW(rows->rows > 0 || count == 0, "counts begin at 0");
            if (rows->rows < ROWS_MAX) {
                rows->counts[rows->rows++] = count;
            }
        }
        LAW(result == 0 && recording_next(&recording, &count) == 0, "what was checked is read without an error, to its end");
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

/* Plain text only: no quotes, no CR, no NUL, no tabs around fields, not more than fits. */
static int read_again(rows_t *rows, char *text, double scale)
{
    char *fields[FIELDS_MAX], *line = text, *end = strchr(text, '\n');
    size_t header = end != NULL ? (size_t)(end - text) : strlen(text);
    char delimiter = memchr(text, '\t', header) ? '\t' : memchr(text, ';', header) ? ';' : ',';
    int columns = 0, angle = 0;
    rows->rows = 0;
    for (; line != NULL; line = end) {
        end = strchr(line, '\n');
        if (end != NULL) {
            *end++ = '\0';
        }
        if (line[strspn(line, " ")] == '\0') {
            if (line[0] != '\0') {
                return 0; /* blanks alone: what that is, is for libcsv to say */
            }
            continue;
        }
        int count = split(line, delimiter, fields);
        if (columns == 0) {
            columns = count;
            angle = find(fields, count);
        } else if (angle >= 0 && !read_row(rows, fields, count, columns, angle, scale)) {
            angle = -1;
        }
    }
    rows->rows = angle < 0 || columns == 0 || rows->rows == 0 ? -1 : rows->rows;
    return 1;
}

static int is_plain(const uint8_t *data, size_t size)
{
    size_t separators = 0;
    for (size_t i = 0; i < size; i++) {
        separators += memchr(",;\t", data[i], 3) != NULL;
        if (memchr("\"\r\0\xEF\v\f", data[i], 6) != NULL) {
            return 0;
        }
    }
    return separators < FIELDS_MAX - 1 && memchr(data, '\t', size) == NULL;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const double scales[4] = {1, 1e3, -1e15, 0.25};
    static rows_t rows, again;
    static char text[8192];
    if (size < 2 || size >= sizeof text) {
        return 0;
    }
    double scale = scales[data[0] & 3];
    int timed = data[0] & 4;
    streams_begin(data + 1, size - 1);
    read_all(&rows, scale, timed ? "t" : "");
    memcpy(text, data + 1, size - 1);
    text[size - 1] = '\0';
    if (!timed && is_plain(data + 1, size - 1) && read_again(&again, text, scale) && rows.rows < ROWS_MAX) {
        LAW(again.rows == rows.rows, "refused iff a second reader refuses, with as many rows");
        LAW(rows.rows < 0 || memcmp(again.counts, rows.counts, (size_t)rows.rows * sizeof rows.counts[0]) == 0,
            "rows are what a second reader reads");
    }
    return 0;
}

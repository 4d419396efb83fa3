/* SPDX-License-Identifier: MIT */
/* libcsv receives one line at a time, so that its callbacks have the number of the line. */
#include "recording.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "stderr_messages.h"

#define NO_COLUMN SIZE_MAX
#define FIELD_MAX 65536u

static void fail(recording_t *self)
{
    self->has_failed = true;
}

/* Limit the memory of a field. Without it, the parser would read the whole file into a field whose quote never closes. */
static void *limited_realloc(void *memory, size_t size)
{
    return size > FIELD_MAX ? NULL : realloc(memory, size);
}

static void append_to_header(recording_t *self, const char *text)
{
    size_t used = strlen(self->header);
    snprintf(self->header + used, sizeof self->header - used, "%s\"%s\"", used > 0 ? ", " : "", text);
}

static void match_column(recording_t *self, const char *text, const char *name, size_t *column)
{
    if (name[0] == '\0' || strcmp(text, name) != 0) {
        return;
    }
    if (*column != NO_COLUMN && !self->has_failed) {
        log_error("%s:%llu: two columns \"%s\"", self->path, (unsigned long long)self->line, name);
        fail(self);
    }
    *column = self->column;
}

static void on_header_field(recording_t *self, const char *text)
{
    append_to_header(self, text);
    match_column(self, text, self->angle_name, &self->angle_column);
    match_column(self, text, self->time_name, &self->time_column);
    match_column(self, text, self->load_name, &self->load_column);
}

static void read_number(recording_t *self, const char *text, const char *name, double *to)
{
    char *end;
    *to = strtod(text, &end);
    if (!self->has_failed && (end == text || *end != '\0' || !isfinite(*to))) {
        log_error("%s:%llu: column \"%s\": \"%.40s\" is not a finite number", self->path,
                 (unsigned long long)self->line, name, text);
        fail(self);
    }
}

/* One field may be several columns. It causes one error line only. */
static void on_data_field(recording_t *self, const char *text)
{
    if (self->column == self->angle_column) {
        read_number(self, text, self->angle_name, &self->angle);
    }
    if (self->column == self->time_column) {
        read_number(self, text, self->time_name, &self->time);
    }
    if (self->column == self->load_column) {
        read_number(self, text, self->load_name, &self->load);
    }
}

static void on_field(void *field, size_t length, void *user)
{
    recording_t *self = (recording_t *)user;
    const char *text = field == NULL ? "" : (const char *)field;
    (void)length;
    if (self->has_failed) {
        return;
    }
    if (self->columns == 0) {
        on_header_field(self, text);
    } else {
        on_data_field(self, text);
    }
    self->column++;
}

/* A configured column that the header lacks; NULL if all are found. */
static const char *missing_column(const recording_t *self)
{
    if (self->angle_column == NO_COLUMN) {
        return self->angle_name;
    }
    if (self->time_name[0] != '\0' && self->time_column == NO_COLUMN) {
        return self->time_name;
    }
    return self->load_name[0] != '\0' && self->load_column == NO_COLUMN ? self->load_name : NULL;
}

static void end_header(recording_t *self)
{
    const char *name = missing_column(self);
    self->columns = self->column;
    if (name != NULL) {
        log_error("%s:%llu: no column \"%s\"; the header has %s", self->path, (unsigned long long)self->line, name,
                  self->header);
        fail(self);
    }
}

static bool is_row_whole(recording_t *self)
{
    if (self->column == self->columns) {
        return true;
    }
    log_error("%s:%llu: column \"%s\": the row has %zu fields, the header %zu", self->path,
             (unsigned long long)self->line, self->angle_name, self->column, self->columns);
    fail(self);
    return false;
}

static bool is_time_forward(recording_t *self)
{
    if (self->time_column == NO_COLUMN || self->rows == 0 || self->time >= self->last_time) {
        return true;
    }
    log_error("%s:%llu: column \"%s\": time goes back from %.9g to %.9g", self->path, (unsigned long long)self->line,
             self->time_name, self->last_time, self->time);
    fail(self);
    return false;
}

static bool is_in_range(recording_t *self, double travel)
{
    if (fabs(travel) < INT32_MAX) {
        return true;
    }
    log_error("%s:%llu: column \"%s\": %.9g is %.9g counts from the first row, more than 2^31", self->path,
             (unsigned long long)self->line, self->angle_name, self->angle, travel);
    fail(self);
    return false;
}

static void end_data(recording_t *self)
{
    double counts = self->angle * self->counts_per_unit;
    self->first = self->rows == 0 ? counts : self->first;
    if (!is_row_whole(self) || !is_time_forward(self) || !is_in_range(self, counts - self->first)) {
        return;
    }
    self->last_time = self->time;
    self->loads[self->tail] = self->load;
    self->counts[self->tail++] = (int32_t)lround(counts - self->first);
    self->rows++;
}

static void on_row(int terminator, void *user)
{
    recording_t *self = (recording_t *)user;
    (void)terminator;
    if (self->has_failed) {
        return;
    }
    if (self->columns == 0) {
        end_header(self);
    } else {
        end_data(self);
    }
    self->column = 0;
}

static unsigned char choose_delimiter(const char *text, size_t length)
{
    const char *end = memchr(text, '\n', length);
    size_t line = end == NULL ? length : (size_t)(end - text);
    if (memchr(text, '\t', line) != NULL) {
        return '\t';
    }
    return memchr(text, ';', line) != NULL ? ';' : ',';
}

static void report_bad_csv(recording_t *self)
{
    bool is_too_long = csv_error(&self->parser) == CSV_ENOMEM;
    log_error("%s:%llu: column %zu: %s", self->path, (unsigned long long)self->line, self->column + 1,
             is_too_long ? "a field without end (a quote that is never closed?)" : "a quote inside a field or never closed");
    fail(self);
}

static void parse(recording_t *self, const char *text, size_t length)
{
    if (csv_parse(&self->parser, text, length, on_field, on_row, self) != length && !self->has_failed) {
        report_bad_csv(self);
    }
}

static void feed(recording_t *self, const char *text, size_t length)
{
    while (length > 0 && !self->has_failed) {
        const char *end = memchr(text, '\n', length);
        size_t piece = end == NULL ? length : (size_t)(end - text) + 1;
        parse(self, text, piece);
        self->line += end == NULL ? 0u : 1u;
        text += piece;
        length -= piece;
    }
}

static void finish(recording_t *self)
{
    self->has_ended = true;
    if (ferror(self->file) != 0) {
        log_error("%s:%llu: cannot be read: %s", self->path, (unsigned long long)self->line, strerror(errno));
        fail(self);
        return;
    }
    if (csv_fini(&self->parser, on_field, on_row, self) != 0 && !self->has_failed) {
        report_bad_csv(self);
    }
}

/* Length of a byte order mark at the start. To the parser, a quote after it would be inside a field. */
static size_t mark_length(const char *text, size_t length)
{
    return length >= 3 && memcmp(text, "\xEF\xBB\xBF", 3) == 0 ? 3 : 0;
}

/* Read one chunk. Then counts[0 .. tail) are the rows that ended in it. */
static void read_chunk(recording_t *self)
{
    char chunk[RECORDING_CHUNK];
    bool is_first = ftell(self->file) == 0;
    size_t length = fread(chunk, 1, sizeof chunk, self->file);
    size_t mark = is_first ? mark_length(chunk, length) : 0;
    self->head = 0;
    self->tail = 0;
    if (length == 0) {
        finish(self);
        return;
    }
    if (is_first) {
        csv_set_delim(&self->parser, choose_delimiter(chunk, length));
    }
    feed(self, chunk + mark, length - mark);
}

static void reset_state(recording_t *self)
{
    self->has_ended = false;
    self->line = 1;
    self->rows = 0;
    self->columns = 0;
    self->column = 0;
    self->angle_column = NO_COLUMN;
    self->time_column = NO_COLUMN;
    self->load_column = NO_COLUMN;
    self->header[0] = '\0';
    self->head = 0;
    self->tail = 0;
}

static bool rewind_to_start(recording_t *self)
{
    if (self->is_parser_ready) {
        csv_free(&self->parser);
    }
    reset_state(self);
    self->is_parser_ready = csv_init(&self->parser, CSV_APPEND_NULL | CSV_STRICT | CSV_STRICT_FINI) == 0;
    csv_set_realloc_func(&self->parser, limited_realloc);
    self->has_failed = !self->is_parser_ready || fseek(self->file, 0, SEEK_SET) != 0;
    if (self->has_failed) {
        log_error("%s: cannot be read from the start: %s", self->path, strerror(errno));
    }
    return !self->has_failed;
}

static bool check_all(recording_t *self)
{
    while (!self->has_ended && !self->has_failed) {
        read_chunk(self);
    }
    if (!self->has_failed && self->rows == 0) {
        log_error("%s:%llu: column \"%s\": the file has no rows", self->path, (unsigned long long)self->line,
                 self->angle_name);
        fail(self);
    }
    return !self->has_failed;
}

bool recording_open(recording_t *self, const char *path, const recording_columns_t *columns)
{
    *self = (recording_t){.path = path,
                          .angle_name = columns->angle,
                          .time_name = columns->time,
                          .load_name = columns->load,
                          .counts_per_unit = columns->counts_per_unit};
    self->file = fopen(path, "rb");
    if (self->file == NULL) {
        log_error("%s: %s", path, strerror(errno));
        return false;
    }
    return rewind_to_start(self) && check_all(self) && rewind_to_start(self);
}

int recording_next(recording_t *self, int32_t *count, double *load)
{
    while (self->head == self->tail) {
        if (self->has_failed || self->has_ended) {
            return self->has_failed ? -1 : 0;
        }
        read_chunk(self);
    }
    *load = self->loads[self->head];
    *count = self->counts[self->head++];
    return 1;
}

void recording_close(recording_t *self)
{
    if (self->is_parser_ready) {
        csv_free(&self->parser);
    }
    if (self->file != NULL) {
        fclose(self->file);
    }
}

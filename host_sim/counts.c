/* SPDX-License-Identifier: MIT */
#define _POSIX_C_SOURCE 200809L
#include "counts.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "stderr_messages.h"

static const char BLANKS[] = " \t\r\n";

bool counts_open(counts_t *self, const char *path)
{
    *self = (counts_t){.path = path, .file = fopen(path, "r")};
    if (self->file == NULL) {
        log_error("%s: %s", path, strerror(errno));
    }
    return self->file != NULL;
}

/* Read "count" or "count x". */
static bool parse(const char *text, int32_t *count, double *x)
{
    char *end, *last;
    long long number = strtoll(text, &end, 10);
    *x = strtod(end, &last);
    *count = (int32_t)number;
    return end != text && (*end == '\0' || strchr(BLANKS, *end) != NULL) && number >= INT32_MIN && number <= INT32_MAX &&
           isfinite(*x) && last[strspn(last, BLANKS)] == '\0';
}

int counts_next(counts_t *self, int32_t *count, double *x)
{
    self->line++;
    if (getline(&self->text, &self->room, self->file) < 0) {
        if (ferror(self->file) != 0) {
            return log_error("%s:%llu: cannot be read: %s", self->path, (unsigned long long)self->line, strerror(errno));
        }
        return self->line > 1 ? 0 : log_error("%s: has no counts", self->path);
    }
    if (!parse(self->text, count, x)) {
        return log_error("%s:%llu: %.40s: not a count from %d to %d, or not finite after it", self->path,
                         (unsigned long long)self->line, self->text, INT32_MIN, INT32_MAX);
    }
    return 1;
}

void counts_close(counts_t *self)
{
    free(self->text);
    if (self->file != NULL) {
        fclose(self->file);
    }
}

/* SPDX-License-Identifier: MIT */
#include "lines.h"

#include <errno.h>
#include <string.h>

#include "stderr_messages.h"

bool lines_open(lines_t *self, const char *path)
{
    self->path = path;
    self->line = 0;
    self->file = fopen(path, "r");
    if (self->file == NULL) {
        log_error("%s: %s", path, strerror(errno));
    }
    return self->file != NULL;
}

int lines_next(lines_t *self)
{
    const unsigned long long line = ++self->line;
    size_t used = 0;
    int c;
    while ((c = getc_unlocked(self->file)) != EOF && c != '\n') {
        if (used == LINES_BYTES - 1) {
            return log_error("%s:%llu: longer than %u bytes", self->path, line, LINES_BYTES - 1);
        }
        if (c == '\0') {
            return log_error("%s:%llu: has a byte of 0, so the file is no text in ASCII or UTF-8", self->path, line);
        }
        self->text[used++] = (char)c;
    }
    self->text[used] = '\0';
    if (ferror(self->file) != 0) {
        return log_error("%s:%llu: cannot be read: %s", self->path, line, strerror(errno));
    }
    return c != EOF || used > 0;
}

void lines_close(lines_t *self)
{
    if (self->file != NULL) {
        fclose(self->file);
    }
}

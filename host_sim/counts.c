/* SPDX-License-Identifier: MIT */
#include "counts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "stderr_messages.h"

static const char BLANKS[] = " \t\r";

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

int counts_next(lines_t *lines, int32_t *count, double *x)
{
    int result = lines_next(lines);
    if (result == 0 && lines->line == 1) {
        return log_error("%s: has no counts", lines->path);
    }
    if (result == 1 && !parse(lines->text, count, x)) {
        return log_error("%s:%llu: %.40s: not a count from %d to %d, or not finite after it", lines->path,
                         (unsigned long long)lines->line, lines->text, INT32_MIN, INT32_MAX);
    }
    return result;
}

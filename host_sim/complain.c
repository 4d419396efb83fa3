/* SPDX-License-Identifier: MIT */
/* complain: see complain.h. */
#include "complain.h"

#include <stdarg.h>
#include <stdio.h>

int complain(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    fputs("error: ", stderr);
    vfprintf(stderr, format, arguments);
    fputc('\n', stderr);
    va_end(arguments);
    return -1;
}

void remark(const char *text)
{
    fprintf(stderr, "note: %s\n", text);
}

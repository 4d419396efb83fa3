/* SPDX-License-Identifier: MIT */
#include "stderr_messages.h"

#include <stdarg.h>
#include <stdio.h>

#include "utf8.h"

/* Text from a file may hold control characters. Replace them, so that a message is always one line. */
static void replace_controls(char *text)
{
    for (; *text != '\0'; text++) {
        if ((*text > 0 && *text < ' ') || *text == 0x7F) {
            *text = '?';
        }
    }
}

int log_error(const char *format, ...)
{
    char text[2048];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    replace_controls(text);
    utf8_repair(text);
    fprintf(stderr, "error: %s\n", text);
    return -1;
}

void log_warning(const char *text)
{
    fprintf(stderr, "note: %s\n", text);
}

/* SPDX-License-Identifier: MIT */
#include "stderr_messages.h"

#include <stdarg.h>
#include <stdio.h>

/* Text from a file may hold control characters. Replace them, so that a message is always one line. */
static void replace_controls(char *text)
{
    for (; *text != '\0'; text++) {
        if ((*text > 0 && *text < ' ') || *text == 0x7F) {
            *text = '?';
        }
    }
}

__attribute__((format(printf, 2, 0))) static void print(const char *kind, const char *format, va_list arguments)
{
    char text[2048];
    vsnprintf(text, sizeof text, format, arguments);
    replace_controls(text);
    fprintf(stderr, "%s: %s\n", kind, text);
}

int log_error(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    print("error", format, arguments);
    va_end(arguments);
    return -1;
}

void log_note(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    print("note", format, arguments);
    va_end(arguments);
}

void log_warning(const char *text)
{
    log_note("%s", text);
}

/* SPDX-License-Identifier: MIT */
/* messages: one line on stderr for the user, "error: ..." or "note: ...". The caller decides how to go on. */
#ifndef MESSAGES_H
#define MESSAGES_H

enum { EXIT_BAD_INPUT = 2, EXIT_RUNTIME = 1 };

/* Print "error: " + format, with ? for what a terminal cannot show. Always returns -1. */
int log_error(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* Print "note: " + text. */
void log_warning(const char *text);

#endif

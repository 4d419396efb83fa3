/* SPDX-License-Identifier: MIT */
/* stderr_messages: one line on stderr for the user, "error: ..." or "note: ...". The caller continues or ends. */
#ifndef STDERR_MESSAGES_H
#define STDERR_MESSAGES_H

enum { EXIT_BAD_INPUT = 2, EXIT_RUNTIME = 1 };

/* Print "error: " + format, with ? for each byte that a terminal cannot show. Always returns -1. */
int log_error(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* The same with "note: ". */
void log_note(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* Print "note: " + text: for a function pointer. */
void log_warning(const char *text);

#endif

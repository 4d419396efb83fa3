/* SPDX-License-Identifier: MIT */
/* complain: one line "error: ..." on stderr for the user. The caller decides how to go on. */
#ifndef COMPLAIN_H
#define COMPLAIN_H

enum { EXIT_BAD_INPUT = 2, EXIT_RUNTIME = 1 };

/* Print "error: " + format, with ? for control characters. Always returns -1. */
int complain(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* Print "note: " + text. */
void remark(const char *text);

#endif

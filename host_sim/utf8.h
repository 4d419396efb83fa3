/* SPDX-License-Identifier: MIT */
/* utf8: check and repair text, so that other programs can read it. */
#ifndef UTF8_H
#define UTF8_H

#include <stdbool.h>
#include <stddef.h>

/* Bytes of the first character of a string, 1 to 4; 0 if it is not valid UTF-8. */
size_t utf8_length(const char *text);

bool utf8_is_valid(const char *text);

/* Replace each byte that is not part of a valid character by '?'. */
void utf8_repair(char *text);

#endif

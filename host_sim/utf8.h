/* SPDX-License-Identifier: MIT */
/* utf8: is a text one that other programs can read? */
#ifndef UTF8_H
#define UTF8_H

#include <stdbool.h>
#include <stddef.h>

/* Bytes of the character that text (ended by a 0) begins with, 1 to 4; 0: no character of UTF-8 begins there. */
size_t utf8_length(const char *text);

bool utf8_is_valid(const char *text);

/* Replace every byte that belongs to no character by '?'. */
void utf8_repair(char *text);

#endif

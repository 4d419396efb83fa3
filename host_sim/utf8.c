/* SPDX-License-Identifier: MIT */
#include "utf8.h"

#include <stdint.h>

/* Number of bytes after the first one of a character; 4 if no character starts with it. */
static size_t continuation_bytes(uint8_t first)
{
    return first < 0x80 ? 0 : first < 0xC0 ? 4 : first < 0xE0 ? 1 : first < 0xF0 ? 2 : first < 0xF8 ? 3 : 4;
}

static bool is_character(uint32_t code, size_t more)
{
    static const uint32_t least[] = {0, 0x80, 0x800, 0x10000}; /* a smaller code must be written with fewer bytes */
    bool is_surrogate = code >= 0xD800 && code <= 0xDFFF;
    return code >= least[more] && code <= 0x10FFFF && !is_surrogate;
}

size_t utf8_length(const char *text)
{
    const uint8_t *bytes = (const uint8_t *)text;
    size_t more = continuation_bytes(bytes[0]);
    if (more > 3) {
        return 0;
    }
    uint32_t code = more == 0 ? bytes[0] : bytes[0] & (0x3Fu >> more);
    for (size_t i = 1; i <= more; i++) {
        if ((bytes[i] & 0xC0u) != 0x80u) {
            return 0;
        }
        code = code << 6 | (bytes[i] & 0x3Fu);
    }
    return is_character(code, more) ? more + 1 : 0;
}

bool utf8_is_valid(const char *text)
{
    size_t length = 1;
    while (*text != '\0' && length > 0) {
        length = utf8_length(text);
        text += length;
    }
    return length > 0;
}

void utf8_repair(char *text)
{
    while (*text != '\0') {
        size_t length = utf8_length(text);
        if (length == 0) {
            *text = '?';
            length = 1;
        }
        text += length;
    }
}

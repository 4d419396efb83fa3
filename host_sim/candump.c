/* SPDX-License-Identifier: MIT */
/* candump: see candump.h. Formatted by hand: printf would take longer than the rest of a tick in virtual time. */
#include "candump.h"

#include <errno.h>
#include <string.h>

static const uint32_t ERROR_BIT = 0x20000000u; /* as candump writes error frames */

static char *put_decimal(char *at, uint64_t value, size_t digits)
{
    for (size_t i = digits; i-- > 0;) {
        at[i] = (char)('0' + value % 10);
        value /= 10;
    }
    return at + digits;
}

static char *put_hex(char *at, uint32_t value, size_t digits)
{
    static const char digit[] = "0123456789ABCDEF";
    for (size_t i = digits; i-- > 0;) {
        at[i] = digit[value & 15u];
        value >>= 4;
    }
    return at + digits;
}

static char *put_text(char *at, const char *text)
{
    size_t length = strlen(text);
    memcpy(at, text, length);
    return at + length;
}

static char *put_data(char *at, const can_frame_t *frame)
{
    if ((frame->flags & CAN_FRAME_REMOTE) != 0) {
        *at++ = 'R';
        return at;
    }
    for (size_t i = 0; i < frame->length; i++) {
        at = put_hex(at, frame->data[i], 2);
    }
    return at;
}

bool candump_open(candump_t *log, const char *path, const char *bus_name)
{
    log->bus_name = bus_name;
    log->file = fopen(path, "w");
    return log->file != NULL;
}

void candump_write(candump_t *log, const can_frame_t *frame)
{
    char line[96];
    char *at = line;
    *at++ = '(';
    at = put_decimal(at, frame->time_us / 1000000u, 10);
    *at++ = '.';
    at = put_decimal(at, frame->time_us % 1000000u, 6);
    at = put_text(at, ") ");
    at = put_text(at, log->bus_name);
    *at++ = ' ';
    bool error = (frame->flags & CAN_FRAME_ERROR) != 0;
    at = put_hex(at, frame->id | (error ? ERROR_BIT : 0), (frame->flags & CAN_FRAME_EXTENDED) != 0 || error ? 8 : 3);
    *at++ = '#';
    at = put_data(at, frame);
    *at++ = '\n';
    fwrite(line, 1, (size_t)(at - line), log->file);
}

bool candump_close(candump_t *log)
{
    bool failed = ferror(log->file) != 0;
    int why = failed ? EIO : 0;
    if (fclose(log->file) != 0) {
        failed = true;
        why = errno;
    }
    errno = why;
    return !failed;
}

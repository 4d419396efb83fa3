/* SPDX-License-Identifier: MIT */
/* Lines are formatted without printf, which would be slower than a whole tick in virtual time. */
#define _GNU_SOURCE
#include "candump.h"
#include "timing.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum {
    LINE_MAX = 96,
    WRITE_BYTES = 4096, /* buffered before a write */
    OPEN_TRIES = 200,
    OPEN_NAP_NS = 10000000, /* between tries; 2 s in all */
    LINGER_MS = 2000        /* wait for a stalled reader at the end */
};

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

/* The separator of id and data; that of CAN FD has its flags. */
static char *put_separator(char *at, uint8_t flags)
{
    if ((flags & DAHL_CAN_FRAME_FD) == 0) {
        return put_text(at, "#");
    }
    uint32_t fd_flags = ((flags & DAHL_CAN_FRAME_BRS) != 0 ? 1u : 0) | ((flags & DAHL_CAN_FRAME_ESI) != 0 ? 2u : 0);
    return put_hex(put_text(at, "##"), fd_flags, 1);
}

static char *put_data(char *at, const dahl_can_frame_t *frame)
{
    if ((frame->flags & DAHL_CAN_FRAME_REMOTE) != 0) {
        *at++ = 'R';
        return frame->length > 0 ? put_hex(at, frame->length, 1) : at; /* bytes that it requests */
    }
    for (size_t i = 0; i < frame->length; i++) {
        at = put_hex(at, frame->data[i], 2);
    }
    return at;
}

bool candump_open(candump_t *log, const char *path, const char *bus_name, bool is_patient)
{
    const struct timespec nap = {.tv_nsec = OPEN_NAP_NS};
    const int flags = O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NONBLOCK | O_NOCTTY;
    log->bus_name = bus_name;
    log->is_patient = is_patient;
    log->fd = open(path, flags, 0666);
    for (int i = 0; i < OPEN_TRIES && log->fd < 0 && errno == ENXIO && nanosleep(&nap, NULL) == 0; i++) {
        log->fd = open(path, flags, 0666);
    }
    return log->fd >= 0;
}

static uint64_t count_lines(const char *bytes, size_t length)
{
    uint64_t lines = 0;
    for (size_t i = 0; i < length; i++) {
        lines += bytes[i] == '\n' ? 1u : 0u;
    }
    return lines;
}

/* Bytes of an incomplete line if the first `length` bytes of the buffer are written. */
static size_t incomplete_bytes(const candump_t *log, size_t length)
{
    const char *end = memrchr(log->bytes, '\n', length);
    return end == NULL ? length : length - (size_t)(end + 1 - log->bytes);
}

/* The file cannot be written any more. Count the buffered lines as missing and remove the incomplete line (not from a pipe). */
static void give_up(candump_t *log, int why)
{
    struct stat status;
    log->why = why;
    log->missing += count_lines(log->bytes, log->used);
    log->used = 0;
    if (log->torn > 0 && fstat(log->fd, &status) == 0 && S_ISREG(status.st_mode)) {
        log->why = ftruncate(log->fd, status.st_size - (off_t)log->torn) == 0 ? why : errno;
    }
}

/* The file has accepted the first `length` bytes of the buffer. */
static void remove_written(candump_t *log, size_t length)
{
    size_t rest = incomplete_bytes(log, length);
    log->torn = rest == length ? log->torn + rest : rest;
    log->used -= length;
    memmove(log->bytes, log->bytes + length, log->used);
}

/* Write as many bytes as the file accepts without waiting. */
static void flush(candump_t *log)
{
    ssize_t n = 0;
    while (n >= 0 && log->used > 0) {
        n = write(log->fd, log->bytes, log->used);
        remove_written(log, n > 0 ? (size_t)n : 0);
    }
    if (n < 0 && errno != EAGAIN && errno != EINTR) {
        give_up(log, errno);
    }
}

/* Wait until the reader has read some bytes. A signal ends the patience, so that Ctrl-C is never delayed. */
static void flush_within(candump_t *log, int ms)
{
    struct pollfd ready = {.fd = log->fd, .events = POLLOUT};
    flush(log);
    if (log->used > 0 && log->why == 0) {
        log->is_patient = poll(&ready, 1, ms) > 0;
        flush(log);
    }
}

static void put_line(candump_t *log, const char *line, size_t length)
{
    if (log->used + length > sizeof log->bytes) {
        flush_within(log, log->is_patient ? CANDUMP_PATIENCE_MS : 0);
    }
    if (log->used + length > sizeof log->bytes || log->why != 0) {
        log->missing++;
        return;
    }
    memcpy(log->bytes + log->used, line, length);
    log->used += length;
    if (log->used >= WRITE_BYTES) {
        flush(log);
    }
}

void candump_write(candump_t *log, const dahl_can_frame_t *frame)
{
    char line[LINE_MAX];
    char *at = line;
    if ((frame->flags & DAHL_CAN_FRAME_CUT) != 0) {
        log->cut++;
        return;
    }
    *at++ = '(';
    at = put_decimal(at, frame->time_us / US_PER_S, 10);
    *at++ = '.';
    at = put_decimal(at, frame->time_us % US_PER_S, 6);
    at = put_text(at, ") ");
    at = put_text(at, log->bus_name);
    *at++ = ' ';
    bool is_error = (frame->flags & DAHL_CAN_FRAME_ERROR) != 0;
    at = put_hex(at, frame->id | (is_error ? ERROR_BIT : 0), (frame->flags & DAHL_CAN_FRAME_EXTENDED) != 0 || is_error ? 8 : 3);
    at = put_separator(at, frame->flags);
    at = put_data(at, frame);
    *at++ = '\n';
    put_line(log, line, (size_t)(at - line));
}

bool candump_close(candump_t *log)
{
    while (log->used > 0 && log->why == 0) {
        size_t before = log->used;
        flush_within(log, LINGER_MS);
        if (log->used == before) {
            give_up(log, EAGAIN);
        }
    }
    if (close(log->fd) != 0 && log->why == 0) {
        log->why = errno;
    }
    errno = log->why;
    return log->missing == 0 && log->why == 0;
}

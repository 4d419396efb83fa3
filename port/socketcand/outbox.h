/* SPDX-License-Identifier: MIT */
/* outbox: buffer bytes for a socket in fixed memory. No call blocks or raises a signal. */
#ifndef SOCKETCAND_OUTBOX_H
#define SOCKETCAND_OUTBOX_H

#include <stdbool.h>
#include <stddef.h>

#define OUTBOX_SIZE 262144u /* 2 s of an angle and an answer at 1 kHz */

/* begin = end = 0: empty. bytes need not be cleared. */
typedef struct {
    size_t begin;
    size_t end;
    char bytes[OUTBOX_SIZE];
} outbox_t;

/* Append the whole text, or return false if the room is too small. */
bool outbox_put(outbox_t *box, const char *text, size_t length);

/* Send as many bytes as the socket accepts. False: the peer has closed. */
bool outbox_flush(outbox_t *box, int fd);

static inline bool outbox_empty(const outbox_t *box)
{
    return box->begin == box->end;
}

#endif

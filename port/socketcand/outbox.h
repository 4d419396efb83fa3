/* SPDX-License-Identifier: MIT */
/* outbox: bytes that wait for a socket, in fixed memory. Nothing here ever blocks or raises a signal. */
#ifndef SOCKETCAND_OUTBOX_H
#define SOCKETCAND_OUTBOX_H

#include <stdbool.h>
#include <stddef.h>

#define OUTBOX_SIZE 262144u /* 2 s of the pair of frames at 1 kHz */

/* begin = end = 0: empty. bytes need not be cleared. */
typedef struct {
    size_t begin;
    size_t end;
    char bytes[OUTBOX_SIZE];
} outbox_t;

/* All or nothing; false: no room. */
bool outbox_put(outbox_t *box, const char *text, size_t length);

/* Send what the socket takes. False: the peer is gone. */
bool outbox_flush(outbox_t *box, int fd);

static inline bool outbox_empty(const outbox_t *box)
{
    return box->begin == box->end;
}

#endif

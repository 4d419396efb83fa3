/* SPDX-License-Identifier: MIT */
#define _GNU_SOURCE
#include "outbox.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>

static void make_room(outbox_t *box)
{
    memmove(box->bytes, box->bytes + box->begin, box->end - box->begin);
    box->end -= box->begin;
    box->begin = 0;
}

bool outbox_put(outbox_t *box, const char *text, size_t length)
{
    if (length > OUTBOX_SIZE - (box->end - box->begin)) {
        return false;
    }
    if (length > OUTBOX_SIZE - box->end) {
        make_room(box);
    }
    memcpy(box->bytes + box->end, text, length);
    box->end += length;
    return true;
}

bool outbox_flush(outbox_t *box, int fd)
{
    while (!outbox_empty(box)) {
        ssize_t n = send(fd, box->bytes + box->begin, box->end - box->begin, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (n < 0) {
            return errno == EAGAIN || errno == EINTR || errno == ENOBUFS;
        }
        box->begin += (size_t)n;
    }
    box->begin = 0;
    box->end = 0;
    return true;
}

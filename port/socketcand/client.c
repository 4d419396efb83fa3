/* SPDX-License-Identifier: MIT */
#define _GNU_SOURCE
#include "client.h"

#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum { MEMBER_READ_SIZE = 4096, CLOSE_MS = 2000, FLUSH_TRIES = 20, FLUSH_MS = 100 };

static uint64_t monotonic_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000u + (uint64_t)now.tv_nsec / 1000000u;
}

static dahl_can_result_t member_send(dahl_can_bus_t *bus, const dahl_can_frame_t *frame)
{
    socketcand_member_t *self = (socketcand_member_t *)bus;
    char text[TEXT_FRAME_MAX];
    dahl_can_frame_t stamped = *frame;
    stamped.time_us = dahl_can_clock_now_us(&bus->clock);
    stamped.flags |= DAHL_CAN_FRAME_OWN;
    if (frame_queue_room(&self->queue) == 0 || !outbox_put(&self->outbox, text, text_from_send(text, frame))) {
        bus->counts.dropped++;
        return DAHL_CAN_BUS_BUSY;
    }
    frame_queue_put(&self->queue, &stamped);
    return outbox_flush(&self->outbox, self->fd) ? DAHL_CAN_BUS_OK : DAHL_CAN_BUS_GONE;
}

static void feed_member(socketcand_member_t *self, const char *bytes, size_t count)
{
    uint64_t before = self->input.garbage;
    dahl_can_frame_t frame;
    for (size_t i = 0; i < count; i++) {
        if (!text_feed(&self->input, bytes[i])) {
            continue;
        }
        if (!text_to_frame(self->input.element, &frame)) {
            self->bus.counts.garbage++;
        } else if (!frame_queue_put(&self->queue, &frame)) {
            self->bus.counts.dropped++;
        }
    }
    self->bus.counts.garbage += self->input.garbage - before;
}

static bool read_some(socketcand_member_t *self)
{
    char bytes[MEMBER_READ_SIZE];
    ssize_t n = recv(self->fd, bytes, sizeof bytes, MSG_DONTWAIT);
    if (n > 0) {
        feed_member(self, bytes, (size_t)n);
    }
    return n > 0 || (n < 0 && (errno == EAGAIN || errno == EINTR));
}

static dahl_can_result_t member_receive(dahl_can_bus_t *bus, dahl_can_frame_t *frame, uint32_t timeout_us)
{
    socketcand_member_t *self = (socketcand_member_t *)bus;
    if (frame_queue_take(&self->queue, frame)) {
        return DAHL_CAN_BUS_OK;
    }
    if (!outbox_flush(&self->outbox, self->fd)) {
        return DAHL_CAN_BUS_GONE;
    }
    struct pollfd ready = {.fd = self->fd, .events = POLLIN};
    struct timespec wait = {.tv_sec = (time_t)(timeout_us / 1000000u), .tv_nsec = (long)(timeout_us % 1000000u) * 1000};
    if (!outbox_empty(&self->outbox)) {
        ready.events |= POLLOUT;
    }
    if (ppoll(&ready, 1, &wait, NULL) > 0 && (ready.revents & ~POLLOUT) != 0 && !read_some(self)) {
        return DAHL_CAN_BUS_GONE;
    }
    return frame_queue_take(&self->queue, frame) ? DAHL_CAN_BUS_OK : DAHL_CAN_BUS_NONE;
}

static uint32_t member_peers(const dahl_can_bus_t *bus)
{
    (void)bus;
    return 1;
}

/* close() with unread input resets the connection, and the kernel discards the bytes that it has not sent. Thus read until the
 * server closes, within CLOSE_MS. */
static void drain_and_close(int fd)
{
    char bytes[MEMBER_READ_SIZE];
    struct pollfd ready = {.fd = fd, .events = POLLIN};
    uint64_t give_up = monotonic_ms() + CLOSE_MS;
    shutdown(fd, SHUT_WR);
    for (uint64_t now = monotonic_ms(); now < give_up; now = monotonic_ms()) {
        if (poll(&ready, 1, (int)(give_up - now)) <= 0 || recv(fd, bytes, sizeof bytes, MSG_DONTWAIT) <= 0) {
            break;
        }
    }
    close(fd);
}

static void member_close(dahl_can_bus_t *bus)
{
    socketcand_member_t *self = (socketcand_member_t *)bus;
    struct pollfd ready = {.fd = self->fd, .events = POLLOUT};
    for (int i = 0; i < FLUSH_TRIES && !outbox_empty(&self->outbox); i++) {
        if (poll(&ready, 1, FLUSH_MS) < 0 || !outbox_flush(&self->outbox, self->fd)) {
            break;
        }
    }
    drain_and_close(self->fd);
}

static const dahl_can_bus_ops_t member_ops = {member_send, member_receive, member_peers, member_close};

static int close_with(int fd, int why)
{
    if (fd >= 0) {
        close(fd);
    }
    errno = why;
    return -1;
}

/* Wait until the deadline at most. */
static bool wait_for_event(uint64_t deadline_ms, int fd, short events)
{
    struct pollfd ready = {.fd = fd, .events = events};
    const uint64_t now = monotonic_ms();
    return now < deadline_ms && poll(&ready, 1, (int)(deadline_ms - now)) > 0;
}

static int connect_one(const struct addrinfo *address, uint64_t deadline_ms)
{
    const int on = 1;
    int why = 0;
    socklen_t size = sizeof why;
    int fd = socket(address->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (fd < 0) {
        return -1;
    }
    if (connect(fd, address->ai_addr, address->ai_addrlen) != 0 && errno != EINPROGRESS) {
        return close_with(fd, errno);
    }
    if (!wait_for_event(deadline_ms, fd, POLLOUT)) {
        return close_with(fd, ETIMEDOUT);
    }
    if (getsockopt(fd, SOL_SOCKET, SO_ERROR, &why, &size) != 0 || why != 0) {
        return close_with(fd, why);
    }
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    return fd;
}

/* An address that does not answer leaves half of the remaining time to the next ones. */
static int connect_to(const struct addrinfo *list, uint64_t deadline_ms)
{
    int fd = -1;
    for (const struct addrinfo *a = list; a != NULL && fd < 0; a = a->ai_next) {
        const uint64_t now = monotonic_ms(), left = now < deadline_ms ? deadline_ms - now : 0;
        fd = connect_one(a, now + (a->ai_next != NULL ? left / 2 : left));
    }
    return fd;
}

/* Read byte by byte, so that frames after the last answer stay in the socket. */
static bool next_element(socketcand_member_t *self, uint64_t deadline_ms)
{
    char c;
    while (wait_for_event(deadline_ms, self->fd, POLLIN) && recv(self->fd, &c, 1, 0) == 1) {
        if (text_feed(&self->input, c)) {
            return true;
        }
        if (self->input.garbage > 0) {
            break;
        }
    }
    return false;
}

static bool expect(socketcand_member_t *self, const char *element, uint64_t deadline_ms)
{
    return next_element(self, deadline_ms) && strcmp(self->input.element, element) == 0;
}

static bool send_text(socketcand_member_t *self, const char *text)
{
    return outbox_put(&self->outbox, text, strlen(text)) && outbox_flush(&self->outbox, self->fd);
}

static bool handshake(socketcand_member_t *self, const char *name, uint64_t deadline_ms)
{
    char open[64];
    snprintf(open, sizeof open, "< open %s >", name);
    return expect(self, " hi ", deadline_ms) && send_text(self, open) && expect(self, " ok ", deadline_ms) &&
           send_text(self, "< rawmode >") && expect(self, " ok ", deadline_ms);
}

dahl_can_result_t socketcand_join(socketcand_member_t *self, const char *host, const char *port, const char *name,
                             dahl_can_clock_t clock)
{
    const struct addrinfo hints = {.ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM};
    struct addrinfo *list;
    self->bus = (dahl_can_bus_t){.ops = &member_ops, .clock = clock};
    self->fd = -1;
    if (getaddrinfo(host, port, &hints, &list) != 0) {
        errno = EADDRNOTAVAIL;
        return DAHL_CAN_BUS_ERROR;
    }
    const uint64_t deadline_ms = monotonic_ms() + SOCKETCAND_HANDSHAKE_MS;
    self->fd = connect_to(list, deadline_ms);
    const int why = errno;
    freeaddrinfo(list);
    errno = why;
    if (self->fd < 0) {
        return DAHL_CAN_BUS_ERROR;
    }
    if (!handshake(self, name, deadline_ms)) {
        close_with(self->fd, EPROTO);
        return DAHL_CAN_BUS_ERROR;
    }
    return DAHL_CAN_BUS_OK;
}

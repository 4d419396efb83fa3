/* SPDX-License-Identifier: MIT */
/* receive() polls once, and reads input only if the queue has room for all of it. */
#define _GNU_SOURCE
#include "server.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum {
    READ_SIZE = 4096,
    FRAMES_PER_READ = 512, /* the shortest element of a frame is longer than 8 characters */
    QUIET_MS = 100,        /* python-can rejects "< ok >" if a frame follows in the same packet */
    KERNEL_BYTES = 65536,  /* the kernel's default would buffer megabytes for a client that does not read */
    SEGMENT_BYTES = 88,    /* the minimum of TCP_MAXSEG in Linux */
    WINDOW_BYTES = 65536,
    RECEIVE_BYTES = 4 * WINDOW_BYTES,
    LINGER_MS = 2000,
    DRAIN_MS = 50,
    DRAIN_READS = 16,
    POLL_MS = 10
};

static uint64_t real_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

static void leave(socketcand_client_t *client)
{
    close(client->fd);
    client->stage = SOCKETCAND_FREE;
}

static bool is_listening(const socketcand_client_t *client)
{
    return client->stage != SOCKETCAND_FREE && !client->is_leaving;
}

/* Stop sending. Input that has arrived can still be read. Then recv() returns 0, even if the client continues to send. */
static void dismiss(socketcand_client_t *client)
{
    shutdown(client->fd, SHUT_RDWR);
    client->is_leaving = true;
    client->outbox.begin = 0;
    client->outbox.end = 0;
}

/* With Nagle's algorithm, a client delays short frames until the last one is acknowledged, and loses them if it closes with
 * unread input. Linux delays acknowledgements again after each answer, so set the option each time. */
static void acknowledge_at_once(const socketcand_client_t *client)
{
    const int on = 1;
    setsockopt(client->fd, IPPROTO_TCP, TCP_QUICKACK, &on, sizeof on);
}

static void drop(socketcand_server_t *self, socketcand_client_t *client, const char *why)
{
    char text[160];
    snprintf(text, sizeof text, "socketcand client %d dropped: %s", (int)(client - self->clients) + 1, why);
    if (self->report != NULL) {
        self->report(text);
    }
    dismiss(client);
}

static void drop_slow(socketcand_server_t *self, socketcand_client_t *client)
{
    char why[80];
    snprintf(why, sizeof why, "it reads too slowly, %u bytes wait for it",
             (unsigned)(client->outbox.end - client->outbox.begin));
    self->bus.counts.dropped++;
    drop(self, client, why);
}

/* A client that connects but does not enter raw mode would occupy its place for ever. */
static void drop_silent(socketcand_server_t *self)
{
    for (size_t i = 0; i < SOCKETCAND_CLIENTS; i++) {
        socketcand_client_t *client = &self->clients[i];
        bool is_greeting = client->stage == SOCKETCAND_GREETED || client->stage == SOCKETCAND_OPENED;
        if (is_greeting && !client->is_leaving && real_ns() - client->joined_ns > SOCKETCAND_HANDSHAKE_MS * UINT64_C(1000000)) {
            drop(self, client, "it did not enter raw mode in time");
        }
    }
}

static bool is_quiet(const socketcand_client_t *client)
{
    return client->stage == SOCKETCAND_RAW && client->quiet_until_ns != 0;
}

static void end_quiet(socketcand_client_t *client)
{
    if (is_quiet(client) && real_ns() >= client->quiet_until_ns) {
        client->quiet_until_ns = 0;
    }
}

/* A client that has closed its side may have left frames to read, so do not close it here. */
static void flush(socketcand_client_t *client)
{
    end_quiet(client);
    if (!is_listening(client) || is_quiet(client) || outbox_empty(&client->outbox)) {
        return;
    }
    if (outbox_flush(&client->outbox, client->fd)) {
        acknowledge_at_once(client);
    } else {
        dismiss(client);
    }
}

static void flush_all(socketcand_server_t *self)
{
    for (size_t i = 0; i < SOCKETCAND_CLIENTS; i++) {
        flush(&self->clients[i]);
    }
}

/* Wait until the client has read some bytes. A signal ends the patience, so that Ctrl-C is never delayed. */
static bool wait_for(socketcand_server_t *self, socketcand_client_t *client)
{
    struct pollfd ready = {.fd = client->fd, .events = POLLOUT};
    uint64_t give_up = real_ns() + (uint64_t)self->patience_ms * 1000000u;
    size_t before = client->outbox.end - client->outbox.begin;
    while (is_listening(client) && client->outbox.end - client->outbox.begin >= before) {
        if (real_ns() >= give_up) {
            return false;
        }
        if (poll(&ready, 1, POLL_MS) < 0) {
            self->patience_ms = 0;
            return false;
        }
        flush(client);
    }
    return is_listening(client);
}

static void put(socketcand_server_t *self, socketcand_client_t *client, const char *text, size_t length)
{
    while (is_listening(client) && !outbox_put(&client->outbox, text, length)) {
        if (!wait_for(self, client) && is_listening(client)) {
            drop_slow(self, client);
        }
    }
}

static void put_word(socketcand_server_t *self, socketcand_client_t *client, const char *text)
{
    put(self, client, text, strlen(text));
    flush(client);
}

/* Put the frame into the queue of this process, and send its text to each client in raw mode except the sender. */
static dahl_can_result_t deliver(socketcand_server_t *self, const dahl_can_frame_t *frame, const char *text, size_t length,
                                 const socketcand_client_t *sender)
{
    for (size_t i = 0; length > 0 && i < SOCKETCAND_CLIENTS; i++) {
        socketcand_client_t *client = &self->clients[i];
        if (client->stage == SOCKETCAND_RAW && client != sender) {
            put(self, client, text, length);
        }
    }
    if (!frame_queue_put(&self->queue, frame)) {
        self->bus.counts.dropped++;
        return DAHL_CAN_BUS_BUSY;
    }
    return DAHL_CAN_BUS_OK;
}

static dahl_can_result_t server_send(dahl_can_bus_t *bus, const dahl_can_frame_t *frame)
{
    char text[TEXT_FRAME_MAX];
    dahl_can_frame_t stamped = *frame;
    stamped.time_us = dahl_can_clock_now_us(&bus->clock);
    stamped.flags |= DAHL_CAN_FRAME_OWN;
    return deliver((socketcand_server_t *)bus, &stamped, text, text_from_frame(text, &stamped), NULL);
}

static void on_open(socketcand_server_t *self, socketcand_client_t *client, const char *words)
{
    char name[32];
    if (text_word(&words, name, sizeof name) && strcmp(name, self->name) == 0) {
        client->stage = SOCKETCAND_OPENED;
        put_word(self, client, "< ok >");
    } else {
        put_word(self, client, "< error could not open bus >");
    }
}

static void on_rawmode(socketcand_server_t *self, socketcand_client_t *client)
{
    put_word(self, client, "< ok >");
    if (client->stage == SOCKETCAND_OPENED) {
        client->stage = SOCKETCAND_RAW;
        client->quiet_until_ns = real_ns() + (uint64_t)QUIET_MS * 1000000u;
    }
}

static void refuse_command(socketcand_server_t *self, socketcand_client_t *client)
{
    self->bus.counts.garbage++;
    put_word(self, client, "< error unknown command >");
}

static void on_greeting(socketcand_server_t *self, socketcand_client_t *client, const char *element)
{
    char verb[16];
    const char *words = element;
    bool has_verb = text_word(&words, verb, sizeof verb);
    if (has_verb && strcmp(verb, "open") == 0) {
        on_open(self, client, words);
    } else if (has_verb && strcmp(verb, "rawmode") == 0 && client->stage == SOCKETCAND_OPENED) {
        on_rawmode(self, client);
    } else {
        refuse_command(self, client);
    }
}

/* Pass a frame of a client on. The queue keeps 8 bytes of a longer one; the other clients receive all. */
static void pass_on(socketcand_server_t *self, dahl_can_frame_t *frame, const char *element, const socketcand_client_t *sender)
{
    char text[TEXT_LONG_MAX];
    bool is_long = (frame->flags & DAHL_CAN_FRAME_CUT) != 0;
    frame->time_us = dahl_can_clock_now_us(&self->bus.clock);
    size_t length = is_long ? text_from_long_send(text, element, frame) : text_from_frame(text, frame);
    deliver(self, frame, text, length, sender);
}

/* An invalid send is counted and not answered, since python-can stops at an answer that is not a frame. Other commands are
 * answered, as python-can does not send them. */
static void on_raw(socketcand_server_t *self, socketcand_client_t *client, const char *element)
{
    dahl_can_frame_t frame;
    client->quiet_until_ns = 0; /* a client that sends has read "< ok >" */
    if (text_to_send(element, &frame)) {
        pass_on(self, &frame, element, client);
    } else if (text_is_send(element)) {
        self->bus.counts.garbage++;
    } else {
        refuse_command(self, client);
    }
}

static void on_element(socketcand_server_t *self, socketcand_client_t *client, const char *element)
{
    if (strcmp(element, " echo ") == 0) {
        put_word(self, client, "< echo >");
    } else if (client->stage == SOCKETCAND_RAW) {
        on_raw(self, client, element);
    } else {
        on_greeting(self, client, element);
    }
}

static void feed(socketcand_server_t *self, socketcand_client_t *client, const char *bytes, size_t count)
{
    uint64_t before = client->input.garbage;
    for (size_t i = 0; i < count && client->stage != SOCKETCAND_FREE; i++) {
        if (text_feed(&client->input, bytes[i])) {
            on_element(self, client, client->input.element);
        }
    }
    self->bus.counts.garbage += client->input.garbage - before;
}

static void read_from(socketcand_server_t *self, socketcand_client_t *client)
{
    char bytes[READ_SIZE];
    ssize_t n = recv(client->fd, bytes, sizeof bytes, MSG_DONTWAIT);
    if (n > 0) {
        acknowledge_at_once(client);
        feed(self, client, bytes, (size_t)n);
    } else if (n == 0 || (errno != EAGAIN && errno != EINTR)) {
        leave(client);
    }
}

static socketcand_client_t *free_client(socketcand_server_t *self)
{
    for (size_t i = 0; i < SOCKETCAND_CLIENTS; i++) {
        if (self->clients[i].stage == SOCKETCAND_FREE) {
            return &self->clients[i];
        }
    }
    return NULL;
}

/* python-can shows this text to its user. Without it, python-can reports only a missing greeting. */
static void refuse(socketcand_server_t *self, int fd)
{
    char text[80];
    int length = snprintf(text, sizeof text, "< error %d clients are here, no more >", (int)SOCKETCAND_CLIENTS);
    (void)!send(fd, text, (size_t)length, MSG_NOSIGNAL | MSG_DONTWAIT); /* the client may have closed already */
    close(fd);
    if (self->report != NULL) {
        snprintf(text, sizeof text, "socketcand client refused: %d are here, no more", (int)SOCKETCAND_CLIENTS);
        self->report(text);
    }
}

static void greet(socketcand_server_t *self, socketcand_client_t *client, int fd)
{
    const int on = 1;
    const int kernel_bytes = KERNEL_BYTES;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &kernel_bytes, sizeof kernel_bytes);
    client->fd = fd;
    client->stage = SOCKETCAND_GREETED;
    client->joined_ns = real_ns();
    client->quiet_until_ns = 0;
    client->is_leaving = false;
    client->input.inside = false;
    client->outbox.begin = 0;
    client->outbox.end = 0;
    put_word(self, client, "< hi >");
}

static void join(socketcand_server_t *self)
{
    socketcand_client_t *client = free_client(self);
    int fd = accept4(self->listener, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (fd >= 0 && client != NULL) {
        greet(self, client, fd);
    } else if (fd >= 0) {
        refuse(self, fd);
    }
}

static void watch(const socketcand_server_t *self, struct pollfd *fds)
{
    short read = frame_queue_room(&self->queue) >= FRAMES_PER_READ ? POLLIN : 0;
    fds[0] = (struct pollfd){.fd = self->listener, .events = POLLIN};
    for (size_t i = 0; i < SOCKETCAND_CLIENTS; i++) {
        const socketcand_client_t *client = &self->clients[i];
        short write = !is_quiet(client) && !outbox_empty(&client->outbox) ? POLLOUT : 0;
        fds[i + 1] = (struct pollfd){.fd = client->stage == SOCKETCAND_FREE ? -1 : client->fd,
                                     .events = (short)(read | write)};
    }
}

static void serve(socketcand_server_t *self, const struct pollfd *fds)
{
    for (size_t i = 0; i < SOCKETCAND_CLIENTS; i++) {
        if ((fds[i + 1].revents & POLLOUT) != 0) {
            flush(&self->clients[i]);
        }
        if ((fds[i + 1].revents & (POLLIN | POLLHUP | POLLERR)) != 0 &&
            frame_queue_room(&self->queue) >= FRAMES_PER_READ) {
            read_from(self, &self->clients[i]);
        }
    }
    if (fds[0].revents != 0) {
        join(self);
    }
}

static dahl_can_result_t server_receive(dahl_can_bus_t *bus, dahl_can_frame_t *frame, uint32_t timeout_us)
{
    socketcand_server_t *self = (socketcand_server_t *)bus;
    struct pollfd fds[SOCKETCAND_CLIENTS + 1];
    if (frame_queue_take(&self->queue, frame)) {
        return DAHL_CAN_BUS_OK;
    }
    flush_all(self);
    drop_silent(self);
    watch(self, fds);
    struct timespec wait = {.tv_sec = (time_t)(timeout_us / 1000000u), .tv_nsec = (long)(timeout_us % 1000000u) * 1000};
    if (ppoll(fds, SOCKETCAND_CLIENTS + 1, &wait, NULL) > 0) {
        serve(self, fds);
    }
    return frame_queue_take(&self->queue, frame) ? DAHL_CAN_BUS_OK : DAHL_CAN_BUS_NONE;
}

static uint32_t server_peers(const dahl_can_bus_t *bus)
{
    const socketcand_server_t *self = (const socketcand_server_t *)bus;
    uint32_t count = 0;
    for (size_t i = 0; i < SOCKETCAND_CLIENTS; i++) {
        count += self->clients[i].stage == SOCKETCAND_RAW && !is_quiet(&self->clients[i]) ? 1u : 0u;
    }
    return count;
}

static bool has_unsent(const socketcand_server_t *self)
{
    for (size_t i = 0; i < SOCKETCAND_CLIENTS; i++) {
        if (self->clients[i].stage != SOCKETCAND_FREE && !outbox_empty(&self->clients[i].outbox)) {
            return true;
        }
    }
    return false;
}

/* close() with unread input resets the connection, and the client loses the bytes that it has not read. Thus read first. */
static void drain_and_leave(socketcand_client_t *client)
{
    char bytes[READ_SIZE];
    struct pollfd ready = {.fd = client->fd, .events = POLLIN};
    shutdown(client->fd, SHUT_WR);
    for (int i = 0; i < DRAIN_READS && poll(&ready, 1, DRAIN_MS) > 0; i++) {
        if (recv(client->fd, bytes, sizeof bytes, MSG_DONTWAIT) <= 0) {
            break;
        }
    }
    leave(client);
}

static void server_close(dahl_can_bus_t *bus)
{
    socketcand_server_t *self = (socketcand_server_t *)bus;
    uint64_t give_up = real_ns() + LINGER_MS * UINT64_C(1000000);
    close(self->listener);
    while (has_unsent(self) && real_ns() < give_up) {
        struct timespec nap = {.tv_nsec = 1000000};
        flush_all(self);
        nanosleep(&nap, NULL);
    }
    for (size_t i = 0; i < SOCKETCAND_CLIENTS; i++) {
        if (self->clients[i].stage != SOCKETCAND_FREE) {
            drain_and_leave(&self->clients[i]);
        }
    }
}

static const dahl_can_bus_ops_t server_ops = {server_send, server_receive, server_peers, server_close};

/* Make the kernel acknowledge input every SEGMENT_BYTES, even while this process is busy. A client's kernel keeps sent bytes
 * until they are acknowledged, and discards them on a reset. Linux acknowledges early if more than a segment has arrived and
 * the window need not shrink, so segments are short and the buffer is larger than the window. */
static void acknowledge_early(int listener)
{
    const int segment = SEGMENT_BYTES;
    const int window = WINDOW_BYTES;
    const int buffer = RECEIVE_BYTES;
    setsockopt(listener, IPPROTO_TCP, TCP_MAXSEG, &segment, sizeof segment);
    setsockopt(listener, IPPROTO_TCP, TCP_WINDOW_CLAMP, &window, sizeof window);
    setsockopt(listener, SOL_SOCKET, SO_RCVBUF, &buffer, sizeof buffer);
}

static dahl_can_result_t listen_on(int fd, uint16_t *port)
{
    const int on = 1;
    struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons(*port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    acknowledge_early(fd);
    if (bind(fd, (struct sockaddr *)&address, size) != 0 || listen(fd, SOCKETCAND_CLIENTS) != 0 ||
        getsockname(fd, (struct sockaddr *)&address, &size) != 0) {
        return DAHL_CAN_BUS_ERROR;
    }
    *port = ntohs(address.sin_port);
    return DAHL_CAN_BUS_OK;
}

dahl_can_result_t socketcand_serve(socketcand_server_t *self, uint16_t port, const char *name, dahl_can_clock_t clock)
{
    self->bus = (dahl_can_bus_t){.ops = &server_ops, .clock = clock};
    self->name = name;
    self->port = port;
    self->listener = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (self->listener < 0) {
        return DAHL_CAN_BUS_ERROR;
    }
    dahl_can_result_t result = listen_on(self->listener, &self->port);
    if (result != DAHL_CAN_BUS_OK) {
        int why = errno;
        close(self->listener);
        errno = why;
    }
    return result;
}

/* SPDX-License-Identifier: MIT */
/* sockets: see sockets.h. */
#define _GNU_SOURCE
#pragma GCC diagnostic ignored "-Wunused-parameter" /* most calls need no argument */
#include "sockets.h"

#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

play_t play;

static play_peer_t *peer_of(int fd)
{
    HOLDS(fd >= PLAY_FD && fd < PLAY_FD + PLAY_PEERS && play.peers[fd - PLAY_FD].is_connected,
          "a descriptor is used only while it is open");
    return &play.peers[fd - PLAY_FD];
}

int socket(int domain, int type, int protocol)
{
    play.open++;
    if (domain == AF_INET) {
        return PLAY_LISTENER;
    }
    play.peers[0].is_connected = 1; /* socket of the client under test */
    play.peers[0].is_deaf = play.dead_addresses > 0;
    play.dead_addresses -= play.dead_addresses > 0;
    return PLAY_FD;
}

int close(int fd)
{
    play.open--;
    if (fd != PLAY_LISTENER) {
        peer_of(fd)->is_connected = 0;
    }
    return 0;
}

int accept4(int fd, struct sockaddr *address, socklen_t *size, int flags)
{
    for (int i = 0; i < PLAY_PEERS; i++) {
        if (play.peers[i].waits_at_door) {
            play.peers[i].waits_at_door = 0;
            play.peers[i].is_connected = 1;
            play.open++;
            return PLAY_FD + i;
        }
    }
    errno = EAGAIN;
    return -1;
}

ssize_t recv(int fd, void *to, size_t size, int flags)
{
    play_peer_t *peer = peer_of(fd);
    size_t count = peer->says_left < size ? peer->says_left : size;
    if (count == 0) { /* a reset keeps bytes that have arrived */
        errno = peer->is_reset ? ECONNRESET : EAGAIN;
        return peer->has_hung_up ? 0 : -1;
    }
    memcpy(to, peer->says, count);
    peer->says += count;
    peer->says_left -= count;
    return (ssize_t)count;
}

ssize_t send(int fd, const void *bytes, size_t count, int flags)
{
    play_peer_t *peer = peer_of(fd);
    HOLDS(flags & MSG_NOSIGNAL, "send() to a closed peer raises no signal");
    const int is_full = peer->is_deaf || (peer->room_per_poll > 0 && peer->room == 0);
    if (play.send_error != 0 || is_full || peer->is_reset) {
        errno = play.send_error != 0 ? play.send_error : peer->is_reset ? EPIPE : EAGAIN;
        play.send_error = 0;
        return -1;
    }
    count = peer->takes > 0 && peer->takes < count ? peer->takes : count;
    count = peer->room_per_poll > 0 && peer->room < count ? peer->room : count;
    peer->room -= peer->room_per_poll > 0 ? count : 0;
    peer->hears(peer->context, fd - PLAY_FD, bytes, count);
    return (ssize_t)count;
}

static short state_of(int fd, short events)
{
    short state = 0;
    if (fd == PLAY_LISTENER) {
        for (int i = 0; i < PLAY_PEERS; i++) {
            state |= play.peers[i].waits_at_door ? POLLIN : 0;
        }
        return state & events;
    }
    const play_peer_t *peer = peer_of(fd);
    state |= peer->says_left > 0 || peer->has_hung_up || peer->is_reset ? POLLIN : 0;
    state |= peer->is_deaf ? 0 : POLLOUT;
    return (short)((state & events) | (peer->is_reset ? POLLERR : 0));
}

static int look(struct pollfd *fds, nfds_t count, uint64_t wait_ns)
{
    int ready = 0;
    for (int i = 0; i < PLAY_PEERS; i++) {
        play.peers[i].room = play.peers[i].room_per_poll;
    }
    for (nfds_t i = 0; i < count; i++) {
        fds[i].revents = fds[i].fd < 0 || play.delay_ns > wait_ns ? 0 : state_of(fds[i].fd, fds[i].events);
        ready += fds[i].revents != 0;
    }
    play.now_ns += ready ? 1000 + play.delay_ns : wait_ns;
    return ready;
}

int poll(struct pollfd *fds, nfds_t count, int ms)
{
    return look(fds, count, (uint64_t)ms * 1000000u);
}

int ppoll(struct pollfd *fds, nfds_t count, const struct timespec *wait, const sigset_t *mask)
{
    return look(fds, count, (uint64_t)wait->tv_sec * 1000000000u + (uint64_t)wait->tv_nsec);
}

int clock_gettime(clockid_t id, struct timespec *now)
{
    play.now_ns += 1000;
    *now = (struct timespec){(time_t)(play.now_ns / 1000000000u), (long)(play.now_ns % 1000000000u)};
    return 0;
}

int nanosleep(const struct timespec *nap, struct timespec *left)
{
    play.now_ns += 100000000u;
    return 0;
}

int setsockopt(int fd, int level, int name, const void *value, socklen_t size)
{
    return 0;
}

int getsockopt(int fd, int level, int name, void *value, socklen_t *size)
{
    memset(value, 0, *size);
    return 0;
}

int bind(int fd, const struct sockaddr *address, socklen_t size)
{
    return 0;
}

int listen(int fd, int count)
{
    return 0;
}

int getsockname(int fd, struct sockaddr *address, socklen_t *size)
{
    memset(address, 0, *size);
    return 0;
}

int connect(int fd, const struct sockaddr *address, socklen_t size)
{
    return 0;
}

int shutdown(int fd, int how)
{
    peer_of(fd)->has_hung_up |= how == SHUT_RDWR;
    peer_of(fd)->has_seen_end |= how != SHUT_RD;
    return 0;
}

int getaddrinfo(const char *host, const char *port, const struct addrinfo *hints, struct addrinfo **list)
{
    static struct addrinfo addresses[4];
    for (int i = 0; i <= play.dead_addresses; i++) {
        addresses[i].ai_next = i < play.dead_addresses ? &addresses[i + 1] : NULL;
    }
    *list = addresses;
    return 0;
}

void freeaddrinfo(struct addrinfo *list)
{
}

/* SPDX-License-Identifier: MIT */
/* Simulated sockets. The bus under test is compiled with the calls of the kernel renamed to play_..., so nothing waits and the
 * clock advances only here. */
#ifndef FUZZ_SOCKETS_H
#define FUZZ_SOCKETS_H

#include "fuzz.h"

enum { PLAY_PEERS = 3, PLAY_LISTENER = 100, PLAY_FD = 101 };

typedef struct {
    int is_connected, waits_at_door, has_hung_up, is_deaf, is_reset;
    int has_seen_end; /* of what the client sends */
    const uint8_t *says; /* its next bytes */
    size_t says_left;
    size_t takes;              /* bytes that one send() accepts; 0: all */
    size_t room_per_poll, room; /* bytes accepted from one poll() to the next; 0: no limit */
    void (*hears)(void *context, int peer, const char *bytes, size_t count);
    void *context;
} play_peer_t;

typedef struct {
    play_peer_t peers[PLAY_PEERS];
    uint64_t now_ns;
    uint64_t delay_ns; /* from a poll() to what it waits for */
    int dead_addresses; /* of the host, before the one that answers */
    int open;       /* descriptors */
    int send_error; /* errno of the next send(); 0: none */
} play_t;

extern play_t play;

#endif

/* SPDX-License-Identifier: MIT */
/*
 * Sockets of the fuzzer's making: the bus under test is compiled with the calls below renamed to play_..., so that no
 * kernel is asked, nothing waits, and time passes only here. A peer is what it will say, in pieces, and whether it reads.
 */
#ifndef FUZZ_SOCKETS_H
#define FUZZ_SOCKETS_H

#include "fuzz.h"

enum { PLAY_PEERS = 3, PLAY_LISTENER = 100, PLAY_FD = 101 };

typedef struct {
    int is_connected, waits_at_door, has_hung_up, is_deaf, is_reset;
    const uint8_t *says; /* the next piece */
    size_t says_left;
    size_t takes;              /* bytes that a send may put in one piece; 0: all */
    void (*hears)(void *context, int peer, const char *bytes, size_t count);
    void *context;
} play_peer_t;

typedef struct {
    play_peer_t peers[PLAY_PEERS];
    uint64_t now_ns;
    int open; /* descriptors that were given and not closed */
} play_t;

extern play_t play;

#endif

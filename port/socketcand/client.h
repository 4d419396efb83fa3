/* SPDX-License-Identifier: MIT */
/*
 * socketcand client: a member of a bus that another process serves. Received frames have the server's time stamps. The server
 * does not return a frame to its sender, so the client puts its own frames into its queue.
 */
#ifndef SOCKETCAND_CLIENT_H
#define SOCKETCAND_CLIENT_H

#include "dahl_can_bus.h"
#include "../frame_queue.h"
#include "outbox.h"
#include "text.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    dahl_can_bus_t bus; /* first */
    frame_queue_t queue;
    int fd;
    text_splitter_t input;
    outbox_t outbox;
} socketcand_member_t;

/* Resolve the host, then connect, open the bus by name and enter raw mode, within SOCKETCAND_HANDSHAKE_MS however slowly the peer
 * answers. The system's resolver has limits of its own. *self must be all zeros (it is large: make it static).
 * DAHL_CAN_BUS_ERROR: errno is set; EPROTO: the peer is not a socketcand server, does not have this bus, or is too slow. */
dahl_can_result_t socketcand_join(socketcand_member_t *self, const char *host, const char *port, const char *name,
                             dahl_can_clock_t clock);

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
/*
 * socketcand server: this process is the bus. Clients of the socketcand protocol (python-can: -i socketcand) join on a TCP
 * port of 127.0.0.1; every frame goes to all members but the client that sent it, stamped with the bus's own clock.
 *
 * The tick comes first: no call blocks, each client has a bounded outbox, and a client that falls behind by more than
 * that is dropped with a report. With patience (virtual time, where no tick can be missed) the server waits instead.
 * A client that has not opened the bus and entered raw mode SOCKETCAND_HANDSHAKE_MS after it connected is dropped too.
 *
 * All frames that reach this machine before a client leaves are carried, also if the client closes with unread input.
 */
#ifndef SOCKETCAND_SERVER_H
#define SOCKETCAND_SERVER_H

#include "dahl_can_bus.h"
#include "../frame_queue.h"
#include "outbox.h"
#include "text.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SOCKETCAND_CLIENTS 16u

typedef enum { SOCKETCAND_FREE = 0, SOCKETCAND_GREETED, SOCKETCAND_OPENED, SOCKETCAND_RAW } socketcand_stage_t;

typedef struct {
    int fd;
    socketcand_stage_t stage;
    uint64_t joined_ns;
    uint64_t quiet_until_ns; /* frames wait in the outbox until then */
    bool is_leaving;         /* no more is sent to it; it is read until the end of its input */
    text_splitter_t input;
    outbox_t outbox;
} socketcand_client_t;

typedef struct {
    dahl_can_bus_t bus; /* first */
    frame_queue_t queue;
    int listener;
    uint16_t port;                     /* the one in use */
    uint32_t patience_ms;              /* 0: never wait for a client */
    const char *name;                  /* of the bus, as clients ask for it */
    void (*report)(const char *text);  /* a line for the user; NULL: silent */
    socketcand_client_t clients[SOCKETCAND_CLIENTS];
} socketcand_server_t;

/* Listen on 127.0.0.1:port, 0: any free one. *self must be all zeros (it is large: make it static); patience_ms and
 * report may be set afterwards. DAHL_CAN_BUS_ERROR: errno says why. */
dahl_can_result_t socketcand_serve(socketcand_server_t *self, uint16_t port, const char *name, dahl_can_clock_t clock);

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
/*
 * socketcand server: this process is the bus. Clients of the socketcand protocol (python-can: -i socketcand) join on a TCP port
 * of 127.0.0.1. Each frame goes to all members except its sender, with a time stamp of the bus's clock.
 *
 * Ticks have priority: no call blocks, and each client has an outbox of fixed size. If the outbox of a slow client is full, the
 * client is dropped with a report. With patience (virtual time, in which no tick can be late) the server waits instead.
 * A client that is not in raw mode SOCKETCAND_HANDSHAKE_MS after it connected is also dropped.
 *
 * All frames that reach this machine before a client leaves are delivered, even if the client closes with unread input.
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
    uint64_t quiet_until_ns; /* frames stay in the outbox until then */
    bool is_leaving;         /* it is sent no more frames, and read to the end of its input */
    text_splitter_t input;
    outbox_t outbox;
} socketcand_client_t;

typedef struct {
    dahl_can_bus_t bus; /* first */
    frame_queue_t queue;
    int listener;
    uint16_t port;                     /* the one in use */
    uint32_t patience_ms;              /* 0: never wait for a client */
    const char *name;                  /* of the bus, in the clients' open command */
    void (*report)(const char *text);  /* print a line for the user; NULL: no report */
    socketcand_client_t clients[SOCKETCAND_CLIENTS];
} socketcand_server_t;

/* Listen on 127.0.0.1:port, 0: any free one. *self must be all zeros (it is large: make it static); patience_ms and
 * report may be set afterwards. DAHL_CAN_BUS_ERROR: errno is set. */
dahl_can_result_t socketcand_serve(socketcand_server_t *self, uint16_t port, const char *name, dahl_can_clock_t clock);

#ifdef __cplusplus
}
#endif

#endif

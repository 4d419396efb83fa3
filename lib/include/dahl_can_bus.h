/* SPDX-License-Identifier: MIT */
/*
 * can_bus: the seam between a node and whatever carries its frames.
 *
 * A bus delivers every frame to every member in one order, the sender included: own frames come back from receive()
 * with DAHL_CAN_FRAME_OWN set. So one reader sees the whole bus, and a log written from receive() is the bus.
 * Each bus in port/ keeps this contract in a folder of its own; a firmware adds its own. Host and firmware choose by linking,
 * not by #ifdef.
 */
#ifndef DAHL_CAN_BUS_H
#define DAHL_CAN_BUS_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    DAHL_CAN_FRAME_EXTENDED = 1, /* 29-bit id */
    DAHL_CAN_FRAME_REMOTE = 2,   /* RTR: no data */
    DAHL_CAN_FRAME_ERROR = 4,    /* error frame of the controller */
    DAHL_CAN_FRAME_FD = 8,       /* CAN FD; only its first 8 bytes are kept */
    DAHL_CAN_FRAME_OWN = 16      /* sent by this process, seen on its way back */
};

/* Id bit of an error frame, as in Linux: the controller is off the bus. Other error frames say nothing of that. */
#define DAHL_CAN_ERROR_BUS_OFF 0x40u

/* Flags that make a frame something other than a classic data frame with an 11-bit id. */
#define DAHL_CAN_FRAME_FOREIGN (DAHL_CAN_FRAME_EXTENDED | DAHL_CAN_FRAME_REMOTE | DAHL_CAN_FRAME_ERROR | DAHL_CAN_FRAME_FD)

typedef struct {
    uint64_t time_us; /* when the bus carried it, on the bus's own clock */
    uint32_t id;      /* 11 or 29 bits */
    uint8_t flags;    /* DAHL_CAN_FRAME_* */
    uint8_t length;   /* bytes in data, 0..8 */
    uint8_t data[8];
} dahl_can_frame_t;

typedef enum {
    DAHL_CAN_BUS_OK = 0,
    DAHL_CAN_BUS_NONE = 1,  /* receive: no frame came in time */
    DAHL_CAN_BUS_BUSY = 2,  /* send: no room, the frame was dropped and counted */
    DAHL_CAN_BUS_GONE = -1, /* the bus is gone; nothing more will come */
    DAHL_CAN_BUS_ERROR = -2 /* open: it cannot be had; the reason is in errno or in the error text */
} dahl_can_result_t;

/* Where time comes from: a real clock, or the simulation's own. */
typedef struct {
    uint64_t (*now_ns)(void *context);
    void (*wait_us)(void *context, uint32_t us); /* for buses that have nothing to wait on; NULL: they never wait */
    void *context;
} dahl_can_clock_t;

typedef struct {
    uint64_t dropped; /* frames that found no room */
    uint64_t garbage; /* pieces of input that were no frame */
    uint64_t retries; /* sends repeated because the driver's queue was full */
} dahl_can_bus_counts_t;

typedef struct dahl_can_bus dahl_can_bus_t;

typedef struct {
    dahl_can_result_t (*send)(dahl_can_bus_t *bus, const dahl_can_frame_t *frame);                   /* never waits */
    dahl_can_result_t (*receive)(dahl_can_bus_t *bus, dahl_can_frame_t *frame, uint32_t timeout_us); /* 0: only look */
    uint32_t (*peers)(const dahl_can_bus_t *bus);                                                    /* others on the bus */
    void (*close)(dahl_can_bus_t *bus); /* sends what is still queued */
} dahl_can_bus_ops_t;

struct dahl_can_bus {
    const dahl_can_bus_ops_t *ops;
    dahl_can_clock_t clock;
    dahl_can_bus_counts_t counts;
};

/* Not a frame that somebody sent, but an event of the own controller. */
static inline bool dahl_can_is_bus_off(const dahl_can_frame_t *frame)
{
    return (frame->flags & DAHL_CAN_FRAME_ERROR) != 0 && (frame->id & DAHL_CAN_ERROR_BUS_OFF) != 0;
}

static inline uint64_t dahl_can_clock_now_us(const dahl_can_clock_t *clock)
{
    return clock->now_ns(clock->context) / 1000u;
}

static inline dahl_can_result_t dahl_can_bus_send(dahl_can_bus_t *bus, const dahl_can_frame_t *frame)
{
    return bus->ops->send(bus, frame);
}

static inline dahl_can_result_t dahl_can_bus_receive(dahl_can_bus_t *bus, dahl_can_frame_t *frame, uint32_t timeout_us)
{
    return bus->ops->receive(bus, frame, timeout_us);
}

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
/**
 * @file dahl_can_bus.h
 * @brief Interface between a node and a CAN bus.
 *
 * Use it to write a driver for a bus. A bus delivers every frame to every member in one order,
 * including the sender: own frames return from receive() with #DAHL_CAN_FRAME_OWN set. A log of
 * receive() is therefore complete.
 *
 * Each folder of port/ with a bus implements this interface. The linker chooses, not the
 * preprocessor.
 */
#ifndef DAHL_CAN_BUS_H
#define DAHL_CAN_BUS_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Flags of a frame. */
enum {
    DAHL_CAN_FRAME_EXTENDED = 1, /**< 29-bit id */
    DAHL_CAN_FRAME_REMOTE = 2,   /**< RTR: no data */
    DAHL_CAN_FRAME_ERROR = 4,    /**< error frame of the controller */
    DAHL_CAN_FRAME_FD = 8,       /**< CAN FD; only its first 8 bytes are kept */
    DAHL_CAN_FRAME_OWN = 16,     /**< sent by this process */
    DAHL_CAN_FRAME_BRS = 32,     /**< CAN FD: the data had a higher bit rate */
    DAHL_CAN_FRAME_ESI = 64,     /**< CAN FD: the sender is error passive */
    DAHL_CAN_FRAME_CUT = 128     /**< CAN FD with more than 8 bytes: the others are lost */
};

/** Id bit of an error frame, as in Linux: the controller is off the bus. */
#define DAHL_CAN_ERROR_BUS_OFF 0x40u

/** Flags of every frame that is not a classic data frame with an 11-bit id. */
#define DAHL_CAN_FRAME_FOREIGN \
    (DAHL_CAN_FRAME_EXTENDED | DAHL_CAN_FRAME_REMOTE | DAHL_CAN_FRAME_ERROR | DAHL_CAN_FRAME_FD)

/** A CAN frame. */
typedef struct {
    uint64_t time_us; /**< [us] time of transmission on the clock of the bus */
    uint32_t id;      /**< 11 or 29 bits */
    uint8_t flags;    /**< DAHL_CAN_FRAME_... */
    uint8_t length;   /**< [byte] length of data, 0 .. 8 */
    uint8_t data[8];  /**< payload */
} dahl_can_frame_t;

/** Result of a bus call. */
typedef enum {
    DAHL_CAN_BUS_OK = 0,    /**< success */
    DAHL_CAN_BUS_NONE = 1,  /**< receive: no frame before the timeout */
    DAHL_CAN_BUS_BUSY = 2,  /**< send: the queue was full; the frame was dropped and counted */
    DAHL_CAN_BUS_GONE = -1, /**< the bus is gone; no frame will follow */
    DAHL_CAN_BUS_ERROR = -2 /**< open failed; the reason is in errno or in the error text */
} dahl_can_result_t;

/** Source of time: a real clock or that of a simulation. */
typedef struct {
    /** Returns the time in ns. */
    uint64_t (*now_ns)(void *context);
    /** Waits, for a bus without its own wait. If it is NULL, such a bus never waits. */
    void (*wait_us)(void *context, uint32_t us);
    void *context; /**< first argument of both functions */
} dahl_can_clock_t;

/** Counts of a bus. */
typedef struct {
    uint64_t dropped; /**< frames dropped because a queue was full */
    uint64_t garbage; /**< pieces of input that were not a frame */
    uint64_t retries; /**< sends repeated because the queue of the driver was full */
} dahl_can_bus_counts_t;

/** An open bus. */
typedef struct dahl_can_bus dahl_can_bus_t;

/** Functions that a bus implements. */
typedef struct {
    /** Sends a frame. It never waits. */
    dahl_can_result_t (*send)(dahl_can_bus_t *bus, const dahl_can_frame_t *frame);
    /** Receives a frame. If timeout_us is 0, it does not wait. */
    dahl_can_result_t (*receive)(dahl_can_bus_t *bus, dahl_can_frame_t *frame, uint32_t timeout_us);
    /** Returns the number of other members. */
    uint32_t (*peers)(const dahl_can_bus_t *bus);
    /** Sends the queued frames, then closes the bus. */
    void (*close)(dahl_can_bus_t *bus);
} dahl_can_bus_ops_t;

/** First member of every bus. */
struct dahl_can_bus {
    const dahl_can_bus_ops_t *ops; /**< functions */
    dahl_can_clock_t clock;        /**< source of time */
    dahl_can_bus_counts_t counts;  /**< counts since open */
};

/** Return true if the own controller reports bus-off. */
static inline bool dahl_can_is_bus_off(const dahl_can_frame_t *frame)
{
    return (frame->flags & DAHL_CAN_FRAME_ERROR) != 0 && (frame->id & DAHL_CAN_ERROR_BUS_OFF) != 0;
}

/** Return the time of a clock in us. */
static inline uint64_t dahl_can_clock_now_us(const dahl_can_clock_t *clock)
{
    return clock->now_ns(clock->context) / 1000u;
}

/** Send a frame; see dahl_can_bus_ops_t. */
static inline dahl_can_result_t dahl_can_bus_send(dahl_can_bus_t *bus,
                                                  const dahl_can_frame_t *frame)
{
    return bus->ops->send(bus, frame);
}

/** Receive a frame; see dahl_can_bus_ops_t. */
static inline dahl_can_result_t dahl_can_bus_receive(dahl_can_bus_t *bus, dahl_can_frame_t *frame,
                                                     uint32_t timeout_us)
{
    return bus->ops->receive(bus, frame, timeout_us);
}

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
/**
 * @file dahl_frames.h
 * @brief CAN frames of a friction node: pack, unpack and check.
 *
 * Use it to exchange frames with a node. dahl.dbc describes the same frames.
 *
 * All frames have 8 bytes, little endian, and an 11-bit id with the node number n = 0 .. 15 in the
 * low 4 bits:
 * @code{.text}
 *   EncoderState   0x100+n  every 1 ms     encoder -> node
 *   FrictionTorque 0x110+n  on reception   node -> all; answers an EncoderState
 *   Status         0x120+n  every 100 ms   node -> all; also at once after power-on, a timeout,
 *                                          a bus-off and a Reset
 *   ParamWrite     0x130+n  on request     any -> node; sets or reads one parameter
 *   ParamReply     0x140+n  on reception   node -> all; the present value
 *   Reset          0x150+n  on request     any -> node; answered by Status
 * @endcode
 *
 * @par Protection
 * AUTOSAR E2E profile 2. Byte 0 is CRC-8 (polynomial 0x2F) over bytes 1 .. 7 and a data id, (kind
 * << 4) | counter. The 4-bit counter is in the low half of byte 1. The CRC detects every single and
 * double bit error. Of the 41,664 triples it misses 48, each with bits of the counter.
 *
 * @par Cost
 * One table look-up per byte. No division, no float, no loop of more than 8 iterations.
 */
#ifndef DAHL_FRAMES_H
#define DAHL_FRAMES_H

#include <stdbool.h>
#include <stdint.h>

#include "dahl_can_bus.h"
#include "dahl_parts.h"

#ifdef __cplusplus
extern "C" {
#endif

/** @name Ids of node 0 */
/** @{ */
#define DAHL_FRAMES_ID_ENCODER 0x100u     /**< EncoderState */
#define DAHL_FRAMES_ID_TORQUE 0x110u      /**< FrictionTorque */
#define DAHL_FRAMES_ID_STATUS 0x120u      /**< Status */
#define DAHL_FRAMES_ID_PARAM_WRITE 0x130u /**< ParamWrite */
#define DAHL_FRAMES_ID_PARAM_REPLY 0x140u /**< ParamReply */
#define DAHL_FRAMES_ID_RESET 0x150u       /**< Reset */
/** @} */
/** Number of nodes on one bus. */
#define DAHL_FRAMES_NODES 16u

/** Upper half of the data ids. Any two differ in at least 2 bits, so a frame of one kind does not
 * pass as another. */
enum {
    DAHL_FRAMES_KIND_ENCODER = 0x3,     /**< EncoderState */
    DAHL_FRAMES_KIND_TORQUE = 0xC,      /**< FrictionTorque */
    DAHL_FRAMES_KIND_STATUS = 0x5,      /**< Status */
    DAHL_FRAMES_KIND_PARAM_WRITE = 0x6, /**< ParamWrite */
    DAHL_FRAMES_KIND_PARAM_REPLY = 0x9, /**< ParamReply */
    DAHL_FRAMES_KIND_RESET = 0xA        /**< Reset */
};

/** State of the input of a node, in FrictionTorque and Status. */
typedef enum {
    DAHL_FRAMES_OK = 0,             /**< next in sequence; used, unless the errors of Status show
                                         it as invalid or a jump */
    DAHL_FRAMES_REPEATED = 1,       /**< same counter again; not used */
    DAHL_FRAMES_LOST = 2,           /**< frames missing before it; used as for OK, since the
                                         count is absolute */
    DAHL_FRAMES_WRONG_SEQUENCE = 3, /**< too many missing, out of order, or the third jump in a
                                         row; not integrated */
    DAHL_FRAMES_CRC = 4,            /**< wrong CRC or format; not used */
    DAHL_FRAMES_STALE = 5,          /**< no accepted frame within the timeout */
    DAHL_FRAMES_INIT = 6            /**< no good frame yet; the first good frame is the starting
                                         point */
} dahl_frames_state_t;

/** Result of unpacking. */
typedef enum {
    DAHL_FRAMES_GOOD = 0,        /**< success */
    DAHL_FRAMES_BAD_FORMAT = -1, /**< wrong length, or an extended, remote, FD or error frame */
    DAHL_FRAMES_BAD_CRC = -2     /**< wrong CRC */
} dahl_frames_check_t;

/** EncoderState. */
typedef struct {
    int32_t count;   /**< [counts] absolute position, wraps at 32 bits */
    uint8_t counter; /**< 0 .. 15 */
    bool valid;      /**< false: the encoder marks its count as invalid */
} dahl_encoder_state_t;

/** FrictionTorque. */
typedef struct {
    int32_t torque_q30; /**< [Q30] F/Fc, -2^30 .. 2^30 */
    uint8_t counter;    /**< 0 .. 15 */
    uint8_t state;      /**< dahl_frames_state_t */
    uint8_t echo;       /**< counter of the EncoderState that it answers */
} dahl_friction_torque_t;

/** Sticky error bits of Status. The other bits are 1 << dahl_frames_state_t. */
enum {
    DAHL_FRAMES_ERROR_FORMAT = 1u << 0,  /**< wrong length or kind of frame */
    DAHL_FRAMES_ERROR_INVALID = 1u << 6, /**< count marked as invalid */
    DAHL_FRAMES_ERROR_JUMP = 1u << 7     /**< count further away than MaxStep allows */
};

/** Status. The counts are those since the last Reset, modulo 256. */
typedef struct {
    uint8_t counter;       /**< 0 .. 15 */
    uint8_t state;         /**< dahl_frames_state_t */
    uint8_t errors;        /**< sticky: 1 << state, DAHL_FRAMES_ERROR_... */
    uint8_t lost;          /**< frames missing */
    uint8_t corrupt;       /**< CRC and format errors */
    uint8_t out_of_step;   /**< repeated, wrong sequence, jumps, timeouts and bus-offs */
    uint8_t version_major; /**< 0 .. 15 */
    uint8_t version_minor; /**< 0 .. 15 */
    uint8_t timeout;       /**< [DAHL_FRAMES_TIMEOUT_US] timeout of the node, rounded up; 255:
                                this or longer */
} dahl_node_status_t;

/** [us] Unit of the timeout in Status. */
#define DAHL_FRAMES_TIMEOUT_US 10000u

/** Parameters by number, with the unit of one raw step and the range. */
typedef enum {
    DAHL_FRAMES_PARAM_SIGMA0 = 0,  /**< [2^-10 N m/rad] */
    DAHL_FRAMES_PARAM_FC = 1,      /**< [2^-20 N m] */
    DAHL_FRAMES_PARAM_THETA = 2,   /**< [2^-38 rad/count] */
    DAHL_FRAMES_PARAM_GAIN = 3,    /**< [2^-16] 0 .. 1: fraction of the torque that is sent */
    DAHL_FRAMES_PARAM_LIMIT = 4,   /**< [2^-16 Fc] 0 .. 1: clamp of the torque that is sent */
    DAHL_FRAMES_PARAM_RAMP = 5,    /**< [ms] 0 .. 60000: time of the gain from 0 to 1 */
    DAHL_FRAMES_PARAM_TIMEOUT = 6, /**< [ms] 1 .. 60000 */
    DAHL_FRAMES_PARAM_STEP = 7,    /**< [counts/ms] MaxStep, 0 .. 2^31 - 1: limit of a plausible
                                        speed; 0: no limit */
    DAHL_FRAMES_PARAM_STATUS = 8,  /**< [ms] 0 .. 60000: period of Status; 0: only after an
                                        event */
    DAHL_FRAMES_PARAM_MODEL = 9,   /**< read only: DAHL_FRAMES_MODEL_... */
    DAHL_FRAMES_PARAM_LOAD = 10,   /**< [2^-16] 0 .. 1: load relative to that of Fc; for the
                                        model Loaded only */
    DAHL_FRAMES_PARAM_NONE = 255   /**< in a reply: unknown parameter; the value is its number */
} dahl_frames_param_t;

/** The table of models in dahl_parts.h. */
#define DAHL_FRAMES_MODELS(MODEL) DAHL_MODELS(MODEL)

/** One value of parameter Model. */
#define DAHL_FRAMES_MODEL(name, NAME, Class, number, ...) \
    DAHL_FRAMES_MODEL_##NAME = (number),

/** Values of parameter Model: DAHL_FRAMES_MODEL_NAME of each row. */
enum { DAHL_MODELS(DAHL_FRAMES_MODEL) };

/** Kinds of ParamWrite. To change several of Sigma0, Fc and ThetaPerCount, write all but the last
 * with HOLD and the last with WRITE. They apply together or not at all: a rejected write drops the
 * held values. */
enum {
    DAHL_FRAMES_PARAM_READ = 0,  /**< reply only */
    DAHL_FRAMES_PARAM_WRITE = 1, /**< apply at once, with the held values */
    DAHL_FRAMES_PARAM_HOLD = 2   /**< hold for the next WRITE of one of the three */
};

/** Results in ParamReply. */
enum {
    DAHL_FRAMES_PARAM_DONE = 0,         /**< success */
    DAHL_FRAMES_PARAM_OUT_OF_RANGE = 1, /**< rejected; the value is unchanged */
    DAHL_FRAMES_PARAM_UNKNOWN = 2       /**< there is no such parameter */
};

/** ParamWrite. */
typedef struct {
    uint32_t value;  /**< raw value */
    uint8_t counter; /**< 0 .. 15 */
    uint8_t param;   /**< dahl_frames_param_t */
    uint8_t write;   /**< DAHL_FRAMES_PARAM_READ, _WRITE or _HOLD */
} dahl_param_write_t;

/** ParamReply. */
typedef struct {
    uint32_t value;  /**< present raw value; if it does not fit in 32 bits, the nearest that does */
    uint8_t counter; /**< counter of the ParamWrite */
    uint8_t param;   /**< dahl_frames_param_t */
    uint8_t result;  /**< DAHL_FRAMES_PARAM_DONE, _OUT_OF_RANGE or _UNKNOWN */
} dahl_param_reply_t;

/** Kinds of Reset. */
enum {
    DAHL_FRAMES_RESET_ERRORS = 1, /**< clear the sticky errors and the counts of Status */
    DAHL_FRAMES_RESET_RESTART = 2 /**< return to the state after power-on, but keep the
                                       parameters */
};

/** Reset. */
typedef struct {
    uint8_t counter; /**< 0 .. 15 */
    uint8_t what;    /**< DAHL_FRAMES_RESET_ERRORS or _RESTART */
} dahl_node_reset_t;

/**
 * @name Pack
 * Write a frame of node 0 .. 15; higher bits are ignored. Flags and time are set to 0.
 */
/** @{ */
/** Pack EncoderState. */
void dahl_frames_pack_encoder(dahl_can_frame_t *frame, uint8_t node,
                              const dahl_encoder_state_t *in);
/** Pack FrictionTorque. */
void dahl_frames_pack_torque(dahl_can_frame_t *frame, uint8_t node,
                             const dahl_friction_torque_t *in);
/** Pack Status. */
void dahl_frames_pack_status(dahl_can_frame_t *frame, uint8_t node, const dahl_node_status_t *in);
/** Pack ParamWrite. */
void dahl_frames_pack_param_write(dahl_can_frame_t *frame, uint8_t node,
                                  const dahl_param_write_t *in);
/** Pack ParamReply. */
void dahl_frames_pack_param_reply(dahl_can_frame_t *frame, uint8_t node,
                                  const dahl_param_reply_t *in);
/** Pack Reset. */
void dahl_frames_pack_reset(dahl_can_frame_t *frame, uint8_t node, const dahl_node_reset_t *in);
/** @} */

/**
 * @name Unpack
 * Check length, flags and CRC, then read a frame. The caller must check the id. `out` is written
 * only if the result is #DAHL_FRAMES_GOOD.
 */
/** @{ */
/** Unpack EncoderState. */
dahl_frames_check_t dahl_frames_unpack_encoder(const dahl_can_frame_t *frame,
                                               dahl_encoder_state_t *out);
/** Unpack FrictionTorque. */
dahl_frames_check_t dahl_frames_unpack_torque(const dahl_can_frame_t *frame,
                                              dahl_friction_torque_t *out);
/** Unpack Status. */
dahl_frames_check_t dahl_frames_unpack_status(const dahl_can_frame_t *frame,
                                              dahl_node_status_t *out);
/** Unpack ParamWrite. */
dahl_frames_check_t dahl_frames_unpack_param_write(const dahl_can_frame_t *frame,
                                                   dahl_param_write_t *out);
/** Unpack ParamReply. */
dahl_frames_check_t dahl_frames_unpack_param_reply(const dahl_can_frame_t *frame,
                                                   dahl_param_reply_t *out);
/** Unpack Reset. */
dahl_frames_check_t dahl_frames_unpack_reset(const dahl_can_frame_t *frame, dahl_node_reset_t *out);
/** @} */

/** Return CRC-8H2F of bytes 1 .. 7 and of the data id for this kind and the counter in byte 1. */
uint8_t dahl_frames_crc(const uint8_t data[8], uint8_t kind);

#ifdef __cplusplus
}
#endif

#endif

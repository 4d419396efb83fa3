/* SPDX-License-Identifier: MIT */
/*
 * frames: the CAN frames of a friction node, in C. dahl.dbc says the same; a test holds both together bit by bit.
 *
 * All are 8 bytes, little endian, 11-bit ids with the node number 0..15 in the low 4 bits, protected as AUTOSAR E2E
 * profile 2: byte 0 is CRC-8 (polynomial 0x2F) over bytes 1..7 and one byte of the message's data id list, chosen by the
 * 4-bit counter in the low half of byte 1. Data id list of a kind: (kind << 4) | counter, kind as below.
 *
 *   EncoderState   0x100+n  every 1 ms      encoder -> node
 *   FrictionTorque 0x110+n  on reception    node -> all; echoes the counter that it answers
 *   Status         0x120+n  every 100 ms    node -> all; at once after a timeout and a Reset
 *   ParamWrite     0x130+n  when asked      anybody -> node; sets or reads one parameter
 *   ParamReply     0x140+n  on reception    node -> all; the value that holds now, with the counter of the ParamWrite
 *   Reset          0x150+n  when asked      anybody -> node; answered by Status
 *
 * Of wrong bits the CRC shows every one and every pair; of the 41,664 triples it misses 48, each with bits of the counter.
 *
 * Cost: one table look-up per byte; no division, no float, no loop longer than 8.
 */
#ifndef DAHL_FRAMES_H
#define DAHL_FRAMES_H

#include <stdbool.h>
#include <stdint.h>

#include "dahl_can_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

#define FRAMES_ID_ENCODER 0x100u
#define FRAMES_ID_TORQUE 0x110u
#define FRAMES_ID_STATUS 0x120u
#define FRAMES_ID_PARAM_WRITE 0x130u
#define FRAMES_ID_PARAM_REPLY 0x140u
#define FRAMES_ID_RESET 0x150u
#define FRAMES_NODES 16u

/* High half of the data ids; any two differ in at least 2 bits, so that a frame of one kind passes for no other. */
enum {
    FRAMES_KIND_ENCODER = 0x3,
    FRAMES_KIND_TORQUE = 0xC,
    FRAMES_KIND_STATUS = 0x5,
    FRAMES_KIND_PARAM_WRITE = 0x6,
    FRAMES_KIND_PARAM_REPLY = 0x9,
    FRAMES_KIND_RESET = 0xA
};

/* What a receiver thinks of its input; on the wire in FrictionTorque and Status. */
typedef enum {
    FRAMES_OK = 0,             /* next in sequence, used */
    FRAMES_REPEATED = 1,       /* same counter again, not used */
    FRAMES_LOST = 2,           /* some missing before it, used: the count is absolute */
    FRAMES_WRONG_SEQUENCE = 3, /* too many missing, or out of order: not integrated */
    FRAMES_CRC = 4,            /* wrong CRC or form, not used */
    FRAMES_STALE = 5,          /* nothing good for too long */
    FRAMES_INIT = 6            /* nothing good yet; the first good frame is the starting point */
} frames_state_t;

typedef enum {
    FRAMES_GOOD = 0,
    FRAMES_BAD_FORMAT = -1, /* length, extended, remote, FD or error frame: nothing was read */
    FRAMES_BAD_CRC = -2
} frames_check_t;

typedef struct {
    int32_t count;   /* absolute, wraps at 32 bits */
    uint8_t counter; /* 0..15 */
    bool valid;      /* false: the encoder does not stand by this count */
} encoder_state_t;

typedef struct {
    int32_t torque_q30; /* F/Fc, -2^30..2^30 */
    uint8_t counter;    /* 0..15 */
    uint8_t state;      /* frames_state_t */
    uint8_t echo;       /* counter of the EncoderState answered */
} friction_torque_t;

/* Sticky error bits of Status: bit number = frames_state_t, and three more. */
enum { FRAMES_ERROR_FORMAT = 1u << 0, FRAMES_ERROR_INVALID = 1u << 6, FRAMES_ERROR_JUMP = 1u << 7 };

typedef struct {
    uint8_t counter;       /* 0..15 */
    uint8_t state;         /* frames_state_t */
    uint8_t errors;        /* sticky: 1 << state, FRAMES_ERROR_* */
    uint8_t lost;          /* since the last Reset, modulo 256: frames missing */
    uint8_t corrupt;       /* the same: CRC and format errors */
    uint8_t out_of_step;   /* the same: repeated, wrong sequence, jumps, timeouts and bus-offs */
    uint8_t version_major; /* 0..15 */
    uint8_t version_minor; /* 0..15 */
    uint8_t timeout;       /* of the node, in FRAMES_TIMEOUT_US, rounded up; 255: so long or longer */
} node_status_t;

#define FRAMES_TIMEOUT_US 10000u

/* Parameters by number, with the unit of one raw step. */
typedef enum {
    FRAMES_PARAM_SIGMA0 = 0,  /* 2^-10 N m/rad */
    FRAMES_PARAM_FC = 1,      /* 2^-20 N m */
    FRAMES_PARAM_THETA = 2,   /* 2^-38 rad per count */
    FRAMES_PARAM_GAIN = 3,    /* 2^-16, 0..1: part of the torque that is answered */
    FRAMES_PARAM_LIMIT = 4,   /* 2^-16 of Fc, 0..1: the answer is clamped to it */
    FRAMES_PARAM_RAMP = 5,    /* ms, 0..60000: the gain needs so long from 0 to 1 */
    FRAMES_PARAM_TIMEOUT = 6, /* ms, 1..60000 */
    FRAMES_PARAM_STEP = 7,    /* counts per ms, 0..2^31 - 1: faster is not believed; 0: no limit known */
    FRAMES_PARAM_STATUS = 8,  /* ms, 0..60000: period of Status, 0: only after power-on, a timeout, a bus-off, a Reset */
    FRAMES_PARAM_NONE = 255   /* in a reply: there is no such parameter; the value is the number that was asked for */
} frames_param_t;

/* What a ParamWrite asks. Sigma0, Fc and ThetaPerCount have a range together (dahl_prepare), and a change of one is heard in
 * the torque: all but the last are written with HOLD, and hold together with the last, or none of them does. */
enum { FRAMES_PARAM_READ = 0, FRAMES_PARAM_WRITE = 1, FRAMES_PARAM_HOLD = 2 };

enum { FRAMES_PARAM_DONE = 0, FRAMES_PARAM_OUT_OF_RANGE = 1, FRAMES_PARAM_UNKNOWN = 2 };

typedef struct {
    uint32_t value;  /* raw */
    uint8_t counter; /* 0..15 */
    uint8_t param;   /* frames_param_t */
    uint8_t write;   /* FRAMES_PARAM_READ, _WRITE, _HOLD */
} param_write_t;

typedef struct {
    uint32_t value;  /* raw, as it holds now; what cannot be said in 32 bits is the nearest that can */
    uint8_t counter; /* of the ParamWrite answered */
    uint8_t param;
    uint8_t result; /* FRAMES_PARAM_DONE, _OUT_OF_RANGE, _UNKNOWN */
} param_reply_t;

enum { FRAMES_RESET_ERRORS = 1, FRAMES_RESET_RESTART = 2 };

typedef struct {
    uint8_t counter; /* 0..15 */
    uint8_t what;    /* FRAMES_RESET_ERRORS: sticky errors and counts of Status; _RESTART: as after power-on, but for the
                      * parameters, which are kept */
} node_reset_t;

/* Node 0..15; higher bits are cut. Flags and time of *frame are cleared. */
void frames_pack_encoder(can_frame_t *frame, uint8_t node, const encoder_state_t *in);
void frames_pack_torque(can_frame_t *frame, uint8_t node, const friction_torque_t *in);
void frames_pack_status(can_frame_t *frame, uint8_t node, const node_status_t *in);
void frames_pack_param_write(can_frame_t *frame, uint8_t node, const param_write_t *in);
void frames_pack_param_reply(can_frame_t *frame, uint8_t node, const param_reply_t *in);
void frames_pack_reset(can_frame_t *frame, uint8_t node, const node_reset_t *in);

/* *out is written iff FRAMES_GOOD is returned. The id is the caller's to check. */
frames_check_t frames_unpack_encoder(const can_frame_t *frame, encoder_state_t *out);
frames_check_t frames_unpack_torque(const can_frame_t *frame, friction_torque_t *out);
frames_check_t frames_unpack_status(const can_frame_t *frame, node_status_t *out);
frames_check_t frames_unpack_param_write(const can_frame_t *frame, param_write_t *out);
frames_check_t frames_unpack_param_reply(const can_frame_t *frame, param_reply_t *out);
frames_check_t frames_unpack_reset(const can_frame_t *frame, node_reset_t *out);

/* CRC-8H2F of bytes 1..7 and the data id that the kind and the counter in byte 1 choose. */
uint8_t frames_crc(const uint8_t data[8], uint8_t kind);

#ifdef __cplusplus
}
#endif

#endif

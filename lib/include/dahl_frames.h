/* SPDX-License-Identifier: MIT */
/*
 * frames: the CAN frames of a friction node, in C. dahl.dbc defines them.
 *
 * All are 8 bytes, little endian, 11-bit ids with the node number 0..15 in the low 4 bits, protected as AUTOSAR E2E
 * profile 2: byte 0 is CRC-8 (polynomial 0x2F) over bytes 1..7 and one byte of the message's data id list, chosen by the
 * 4-bit counter in the low half of byte 1. Data id list of a kind: (kind << 4) | counter, kind as below.
 *
 *   EncoderState   0x100+n  every 1 ms      encoder -> node
 *   FrictionTorque 0x110+n  on reception    node -> all; echoes the counter that it answers
 *   Status         0x120+n  every 100 ms    node -> all; at once after power-on, a timeout, a bus-off and a Reset. Parameter
 *                                           Status sets the period; 0: only after these events
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

#define DAHL_FRAMES_NODES 16u

/*
 * States of a receiver, in FrictionTorque and Status:
 *   OK              next in sequence; used unless it was invalid or a jump, which the errors of Status show
 *   REPEATED        same counter again, not used
 *   LOST            some missing before it; used as for OK: the count is absolute
 *   WRONG_SEQUENCE  too many missing, out of order, or the third jump in a row: not integrated
 *   CRC             wrong CRC or form, not used
 *   STALE           no good frame for too long
 *   INIT            no good frame yet; the first one is the starting point
 *
 * Sigma0, Fc and ThetaPerCount have a range together (dahl_prepare). To change more than one, write all but the last with
 * HOLD and the last with WRITE: all become valid together, or all are refused. A refused write drops those held before it.
 * A reply with PARAM_NONE has the unknown number as its value.
 */

/* --- from dahl.dbc by tools/generators/frames.py: begin --- */
#define DAHL_FRAMES_ID_ENCODER 0x100u
#define DAHL_FRAMES_ID_TORQUE 0x110u
#define DAHL_FRAMES_ID_STATUS 0x120u
#define DAHL_FRAMES_ID_PARAM_WRITE 0x130u
#define DAHL_FRAMES_ID_PARAM_REPLY 0x140u
#define DAHL_FRAMES_ID_RESET 0x150u

#define DAHL_FRAMES_TIMEOUT_US 10000u /* one step of the timeout in Status */

/* High half of the data ids; any two differ in at least 2 bits: a frame of one kind passes for no other. */
enum {
    DAHL_FRAMES_KIND_ENCODER = 0x3,
    DAHL_FRAMES_KIND_TORQUE = 0xC,
    DAHL_FRAMES_KIND_STATUS = 0x5,
    DAHL_FRAMES_KIND_PARAM_WRITE = 0x6,
    DAHL_FRAMES_KIND_PARAM_REPLY = 0x9,
    DAHL_FRAMES_KIND_RESET = 0xA
};

typedef enum {
    DAHL_FRAMES_OK = 0,
    DAHL_FRAMES_REPEATED = 1,
    DAHL_FRAMES_LOST = 2,
    DAHL_FRAMES_WRONG_SEQUENCE = 3,
    DAHL_FRAMES_CRC = 4,
    DAHL_FRAMES_STALE = 5,
    DAHL_FRAMES_INIT = 6
} dahl_frames_state_t;

typedef enum {
    DAHL_FRAMES_PARAM_SIGMA0 = 0,  /* 2^-10 N m/rad; 1 .. 4294967295 */
    DAHL_FRAMES_PARAM_FC = 1,      /* 2^-20 N m; 1 .. 4294967295 */
    DAHL_FRAMES_PARAM_THETA = 2,   /* 2^-38 rad; 1 .. 4294967295 */
    DAHL_FRAMES_PARAM_GAIN = 3,    /* 2^-16; 0 .. 65536 */
    DAHL_FRAMES_PARAM_LIMIT = 4,   /* 2^-16; 0 .. 65536 */
    DAHL_FRAMES_PARAM_RAMP = 5,    /* ms; 0 .. 60000 */
    DAHL_FRAMES_PARAM_TIMEOUT = 6, /* ms; 1 .. 60000 */
    DAHL_FRAMES_PARAM_STEP = 7,    /* count/ms; 0 .. 2147483647 */
    DAHL_FRAMES_PARAM_STATUS = 8,  /* ms; 0 .. 60000 */
    DAHL_FRAMES_PARAM_MODEL = 9,   /* 0 .. 40 */
    DAHL_FRAMES_PARAM_LOAD = 10,   /* 2^-16; 0 .. 65536 */
    DAHL_FRAMES_PARAM_NONE = 255
} dahl_frames_param_t;

enum { DAHL_FRAMES_PARAM_READ = 0, DAHL_FRAMES_PARAM_WRITE = 1, DAHL_FRAMES_PARAM_HOLD = 2 };

enum { DAHL_FRAMES_PARAM_DONE = 0, DAHL_FRAMES_PARAM_OUT_OF_RANGE = 1, DAHL_FRAMES_PARAM_UNKNOWN = 2 };

enum { DAHL_FRAMES_RESET_ERRORS = 1, DAHL_FRAMES_RESET_RESTART = 2 };

enum { DAHL_FRAMES_ERROR_FORMAT = 1u << 0, DAHL_FRAMES_ERROR_INVALID = 1u << 6, DAHL_FRAMES_ERROR_JUMP = 1u << 7 };

typedef struct {
    int32_t count;   /* Absolute position in counts, wraps at 32 bits. */
    uint8_t counter; /* Increases by 1 with each frame, 15 is followed by 0. */
    bool valid;      /* 0: the encoder does not stand by this count; the node does not use it. */
} dahl_encoder_state_t;

typedef struct {
    int32_t torque_q30; /* In 2^-30. Friction torque as a part of the Coulomb torque, with the sign of the motion. */
    uint8_t counter;    /* Increases by 1 with each frame, 15 is followed by 0. */
    uint8_t state;      /* State of the receiver after the frame that it answers. */
    uint8_t echo;       /* Counter of the EncoderState answered: latency, loss and order can be read from a log alone. */
} dahl_friction_torque_t;

typedef struct {
    uint8_t counter;       /* Increases by 1 with each frame, 15 is followed by 0. */
    uint8_t state;         /* State of the receiver now. */
    uint8_t errors;        /* Sticky bits: 1 << State, FORMAT, INVALID, JUMP. */
    uint8_t lost;          /* Frames missing by the counter since the last Reset, modulo 256. */
    uint8_t corrupt;       /* Frames with wrong CRC or form since the last Reset, modulo 256. */
    uint8_t out_of_step;   /* Repeated frames, wrong sequences, jumps, timeouts, bus-offs since the last Reset, modulo 256. */
    uint8_t version_major; /* Version of the library, first number. */
    uint8_t version_minor; /* Version of the library, second number. */
    uint8_t timeout;       /* In 10 ms. Silence that makes the node Stale, rounded up; the largest value also means longer. */
} dahl_node_status_t;

typedef struct {
    uint32_t value;  /* Raw value of the parameter, in steps of its unit. */
    uint8_t counter; /* Any value; the answer repeats it. */
    uint8_t param;   /* Number of the parameter. */
    uint8_t write;   /* Read, Write or Hold. */
} dahl_param_write_t;

typedef struct {
    uint32_t value;  /* Raw value of the parameter, in steps of its unit. */
    uint8_t counter; /* Counter of the ParamWrite answered. */
    uint8_t param;   /* Number of the parameter; None if no parameter has the number in Asked. */
    uint8_t result;  /* Result of the ParamWrite; any but Done changes no value. */
} dahl_param_reply_t;

typedef struct {
    uint8_t counter; /* Any value. */
    uint8_t what;    /* Extent of the reset. */
} dahl_node_reset_t;
/* --- from dahl.dbc: end --- */

/* Values of the parameter Model. */
enum {
    DAHL_FRAMES_MODEL_DAHL = 0,
    DAHL_FRAMES_MODEL_SLIP = 0, /* plus the number of slip elements, 1 to 8 */
    DAHL_FRAMES_MODEL_ASYMMETRIC = 16,
    DAHL_FRAMES_MODEL_ELASTOPLASTIC = 17,
    DAHL_FRAMES_MODEL_LOADED = 18,
    DAHL_FRAMES_MODEL_PARALLEL = 32 /* plus the number of elements, 1 to 8 */
};

typedef enum {
    DAHL_FRAMES_GOOD = 0,
    DAHL_FRAMES_BAD_FORMAT = -1, /* length, extended, remote, FD or error frame: not read */
    DAHL_FRAMES_BAD_CRC = -2
} dahl_frames_check_t;

/* Node 0..15; higher bits are cut. Flags and time of *frame are cleared. */
void dahl_frames_pack_encoder(dahl_can_frame_t *frame, uint8_t node, const dahl_encoder_state_t *in);
void dahl_frames_pack_torque(dahl_can_frame_t *frame, uint8_t node, const dahl_friction_torque_t *in);
void dahl_frames_pack_status(dahl_can_frame_t *frame, uint8_t node, const dahl_node_status_t *in);
void dahl_frames_pack_param_write(dahl_can_frame_t *frame, uint8_t node, const dahl_param_write_t *in);
void dahl_frames_pack_param_reply(dahl_can_frame_t *frame, uint8_t node, const dahl_param_reply_t *in);
void dahl_frames_pack_reset(dahl_can_frame_t *frame, uint8_t node, const dahl_node_reset_t *in);

/* *out is written iff DAHL_FRAMES_GOOD is returned. The id is the caller's to check. */
dahl_frames_check_t dahl_frames_unpack_encoder(const dahl_can_frame_t *frame, dahl_encoder_state_t *out);
dahl_frames_check_t dahl_frames_unpack_torque(const dahl_can_frame_t *frame, dahl_friction_torque_t *out);
dahl_frames_check_t dahl_frames_unpack_status(const dahl_can_frame_t *frame, dahl_node_status_t *out);
dahl_frames_check_t dahl_frames_unpack_param_write(const dahl_can_frame_t *frame, dahl_param_write_t *out);
dahl_frames_check_t dahl_frames_unpack_param_reply(const dahl_can_frame_t *frame, dahl_param_reply_t *out);
dahl_frames_check_t dahl_frames_unpack_reset(const dahl_can_frame_t *frame, dahl_node_reset_t *out);

/* CRC-8H2F of bytes 1..7 and the data id that the kind and the counter in byte 1 choose. */
uint8_t dahl_frames_crc(const uint8_t data[8], uint8_t kind);

#ifdef __cplusplus
}
#endif

#endif

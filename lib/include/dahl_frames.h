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

#define DAHL_FRAMES_ID_ENCODER 0x100u
#define DAHL_FRAMES_ID_TORQUE 0x110u
#define DAHL_FRAMES_ID_STATUS 0x120u
#define DAHL_FRAMES_ID_PARAM_WRITE 0x130u
#define DAHL_FRAMES_ID_PARAM_REPLY 0x140u
#define DAHL_FRAMES_ID_RESET 0x150u
#define DAHL_FRAMES_NODES 16u

/* High half of the data ids; any two differ in at least 2 bits, so that a frame of one kind passes for no other. */
enum {
    DAHL_FRAMES_KIND_ENCODER = 0x3,
    DAHL_FRAMES_KIND_TORQUE = 0xC,
    DAHL_FRAMES_KIND_STATUS = 0x5,
    DAHL_FRAMES_KIND_PARAM_WRITE = 0x6,
    DAHL_FRAMES_KIND_PARAM_REPLY = 0x9,
    DAHL_FRAMES_KIND_RESET = 0xA
};

/* What a receiver thinks of its input; on the wire in FrictionTorque and Status. */
typedef enum {
    DAHL_FRAMES_OK = 0,             /* next in sequence; used unless it was invalid or a jump, which the errors of Status show */
    DAHL_FRAMES_REPEATED = 1,       /* same counter again, not used */
    DAHL_FRAMES_LOST = 2,           /* some missing before it; used as for OK: the count is absolute */
    DAHL_FRAMES_WRONG_SEQUENCE = 3, /* too many missing, out of order, or the third jump in a row: not integrated */
    DAHL_FRAMES_CRC = 4,            /* wrong CRC or form, not used */
    DAHL_FRAMES_STALE = 5,          /* nothing good for too long */
    DAHL_FRAMES_INIT = 6            /* nothing good yet; the first good frame is the starting point */
} dahl_frames_state_t;

typedef enum {
    DAHL_FRAMES_GOOD = 0,
    DAHL_FRAMES_BAD_FORMAT = -1, /* length, extended, remote, FD or error frame: nothing was read */
    DAHL_FRAMES_BAD_CRC = -2
} dahl_frames_check_t;

typedef struct {
    int32_t count;   /* absolute, wraps at 32 bits */
    uint8_t counter; /* 0..15 */
    bool valid;      /* false: the encoder does not stand by this count */
} dahl_encoder_state_t;

typedef struct {
    int32_t torque_q30; /* F/Fc, -2^30..2^30 */
    uint8_t counter;    /* 0..15 */
    uint8_t state;      /* dahl_frames_state_t */
    uint8_t echo;       /* counter of the EncoderState answered */
} dahl_friction_torque_t;

/* Sticky error bits of Status: bit number = dahl_frames_state_t, and three more. */
enum { DAHL_FRAMES_ERROR_FORMAT = 1u << 0, DAHL_FRAMES_ERROR_INVALID = 1u << 6, DAHL_FRAMES_ERROR_JUMP = 1u << 7 };

typedef struct {
    uint8_t counter;       /* 0..15 */
    uint8_t state;         /* dahl_frames_state_t */
    uint8_t errors;        /* sticky: 1 << state, DAHL_FRAMES_ERROR_* */
    uint8_t lost;          /* since the last Reset, modulo 256: frames missing */
    uint8_t corrupt;       /* the same: CRC and format errors */
    uint8_t out_of_step;   /* the same: repeated, wrong sequence, jumps, timeouts and bus-offs */
    uint8_t version_major; /* 0..15 */
    uint8_t version_minor; /* 0..15 */
    uint8_t timeout;       /* of the node, in DAHL_FRAMES_TIMEOUT_US, rounded up; 255: so long or longer */
} dahl_node_status_t;

#define DAHL_FRAMES_TIMEOUT_US 10000u

/* Parameters by number, with the unit of one raw step. */
typedef enum {
    DAHL_FRAMES_PARAM_SIGMA0 = 0,  /* 2^-10 N m/rad */
    DAHL_FRAMES_PARAM_FC = 1,      /* 2^-20 N m */
    DAHL_FRAMES_PARAM_THETA = 2,   /* 2^-38 rad per count */
    DAHL_FRAMES_PARAM_GAIN = 3,    /* 2^-16, 0..1: part of the torque that is answered */
    DAHL_FRAMES_PARAM_LIMIT = 4,   /* 2^-16 of Fc, 0..1: the answer is clamped to it */
    DAHL_FRAMES_PARAM_RAMP = 5,    /* ms, 0..60000: the gain needs so long from 0 to 1 */
    DAHL_FRAMES_PARAM_TIMEOUT = 6, /* ms, 1..60000 */
    DAHL_FRAMES_PARAM_STEP = 7,    /* MaxStep, counts per ms, 0..2^31 - 1: faster is not believed; 0: no limit known */
    DAHL_FRAMES_PARAM_STATUS = 8,  /* ms, 0..60000: period of Status, 0: only after power-on, a timeout, a bus-off, a Reset */
    DAHL_FRAMES_PARAM_MODEL = 9,   /* read only: DAHL_FRAMES_MODEL_* */
    DAHL_FRAMES_PARAM_LOAD = 10,   /* 2^-16, 0..1: part of the load at which Fc holds; for the model Loaded only */
    DAHL_FRAMES_PARAM_NONE = 255   /* in a reply: there is no such parameter; the value is the number that was asked for */
} dahl_frames_param_t;

/** The friction models that a node can answer by, except the Dahl element: one row each. Scenes,
 * the Python package, dahl.dbc and docs/loop.md read this table.
 *
 *     MODEL(name, NAME, Class, number, sigma0s, Fcs, plan, key, meaning)
 *
 * - name: in scenes and options. Its calls are dahl_name_..., those of the Dahl element dahl_...
 * - NAME: DAHL_FRAMES_MODEL_NAME is its number.
 * - Class: in dahl.dbc and of the Python package, where the Dahl element is a Plan.
 * - number: value of parameter Model. If sigma0s is 0, the number of elements is added.
 * - sigma0s: how many sigma0 [N m/rad]; 0: one for each of 1 .. DAHL_SLIP_MAX elements.
 * - Fcs: how many Fc [N m]; 0: one for each element; 2: forward and backward. The torque ratio
 *   refers to their sum, of forward and backward to the larger one.
 * - plan: 1 if it has a type dahl_name_plan_t, which may be constant in flash.
 * - key: its own key in [friction] of a scene; "" if there is none.
 * - meaning: of that key, or of other data that the model needs. */
/* clang-format off */
#define DAHL_FRAMES_OTHER_MODELS(MODEL) \
    MODEL(slip, SLIP, Slip, 0, 0, 0, 1, "", "") \
    MODEL(parallel, PARALLEL, Parallel, 32, 0, 0, 0, "kinds", "`dahl` or `slip` for each element") \
    MODEL(asymmetric, ASYMMETRIC, Asymmetric, 16, 1, 2, 1, "", "") \
    MODEL(elastoplastic, ELASTOPLASTIC, ElastoPlastic, 17, 1, 1, 1, "breakaway", "a fraction of Fc") \
    MODEL(loaded, LOADED, Loaded, 18, 1, 1, 0, "", \
          "a section `[load]`; `sigma0` and `Fc` hold at load 1")
/* clang-format on */

/** All models: the Dahl element and DAHL_FRAMES_OTHER_MODELS. */
#define DAHL_FRAMES_MODELS(MODEL) \
    MODEL(dahl, DAHL, Dahl, 0, 1, 1, 1, "", "") \
    DAHL_FRAMES_OTHER_MODELS(MODEL)

/** One value of parameter Model. */
#define DAHL_FRAMES_MODEL(name, NAME, Class, number, sigma0s, Fcs, plan, key, meaning) \
    DAHL_FRAMES_MODEL_##NAME = number,

/** Values of parameter Model: DAHL_FRAMES_MODEL_NAME of each row. */
enum { DAHL_FRAMES_MODELS(DAHL_FRAMES_MODEL) };

/* What a ParamWrite asks. Sigma0, Fc and ThetaPerCount have a range together (dahl_prepare), and a change of one is heard in
 * the torque: all but the last are written with HOLD, and hold together with the last, or none of them does. A refused write
 * drops those held before it. */
enum { DAHL_FRAMES_PARAM_READ = 0, DAHL_FRAMES_PARAM_WRITE = 1, DAHL_FRAMES_PARAM_HOLD = 2 };

enum { DAHL_FRAMES_PARAM_DONE = 0, DAHL_FRAMES_PARAM_OUT_OF_RANGE = 1, DAHL_FRAMES_PARAM_UNKNOWN = 2 };

typedef struct {
    uint32_t value;  /* raw */
    uint8_t counter; /* 0..15 */
    uint8_t param;   /* dahl_frames_param_t */
    uint8_t write;   /* DAHL_FRAMES_PARAM_READ, _WRITE, _HOLD */
} dahl_param_write_t;

typedef struct {
    uint32_t value;  /* raw, as it holds now; what cannot be said in 32 bits is the nearest that can */
    uint8_t counter; /* of the ParamWrite answered */
    uint8_t param;
    uint8_t result; /* DAHL_FRAMES_PARAM_DONE, _OUT_OF_RANGE, _UNKNOWN */
} dahl_param_reply_t;

enum { DAHL_FRAMES_RESET_ERRORS = 1, DAHL_FRAMES_RESET_RESTART = 2 };

typedef struct {
    uint8_t counter; /* 0..15 */
    uint8_t what;    /* DAHL_FRAMES_RESET_ERRORS: sticky errors and counts of Status; _RESTART: as after power-on, but for the
                      * parameters, which are kept */
} dahl_node_reset_t;

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

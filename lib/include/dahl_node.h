/* SPDX-License-Identifier: MIT */
/*
 * node: the friction node, the very file that the firmware links. Frames in, frames out; no I/O, no heap, no OS; no float
 * but where a parameter is read or written.
 *
 *   static dahl_node_t node;
 *   if (dahl_node_init(&node, &params, 0) != DAHL_OK) { stop(); }
 *   on each frame:     if (dahl_node_receive(&node, &in, now_us, &out)) { send(&out); }
 *   every millisecond: if (dahl_node_tick(&node, now_us, &out)) { send(&out); }
 *
 * Every EncoderState that the node accepts is answered once, by a FrictionTorque with the torque after that count.
 * What it does with an EncoderState of its own number is one table, lib/node/fault_table.h: which count goes up, which state
 * Status says, whether the bristle moves, whether there is an answer. The count is absolute, so travel needs no unbroken
 * chain of frames.
 *
 *   Timeout          DAHL_NODE_TIMEOUT_US unless parameter Timeout was written; Status shows it. Then Status says STALE at
 *                    once, on bus-off without waiting for the timeout
 *   Torque then      0: nothing is answered, and the gain begins anew from 0 where there is a ramp
 *   Back again       with the third good frame in a row; its count is the new starting point. After a bus-off these are
 *                    waited for only when a timeout has passed; the fourth bus-off without an answer in between is
 *                    latched until a Reset with Restart
 *
 * Where the bristle is kept and yet an answer is given, the count is a new starting point: counts that passed unseen in a
 * gap are never integrated blindly, a jump of the encoder cannot become a torque. A receiver that hears no
 * FrictionTorque for 3 periods takes 0 by itself.
 * The counter has 4 bits, so a frame that is 13 to 15 periods late looks like one ahead and is used. With a MaxStep, so is one
 * that is 8 to 15 periods late; MaxStep then bounds how far it moves the bristle.
 *
 *   MaxStep          counts per ms. A count is too far away if it exceeds MaxStep for each ms since the last accepted count.
 *                    A begun ms counts. In sequence, there are at least as many ms as steps of the counter
 *
 * Interrupts and threads: the node has no lock, and each call writes *node. Calls for one node must not overlap. If the
 * receive interrupt calls dahl_node_receive and main calls dahl_node_tick, main must mask that interrupt, and read the clock
 * while it is masked:
 *
 *   mask(); due = dahl_node_tick(&node, clock_us(), &out); unmask(); if (due) { send(&out); }
 *
 * The same holds for dahl_node_bus_off, dahl_node_use_NAME and any code that reads or writes a member of the node. No lock is
 * needed if the interrupt only queues frames and main makes all calls. No call waits, and two nodes share nothing.
 *
 * Of dahl_can_bus.h the node needs dahl_can_frame_t with its flags, and no bus. Any driver can fill in id, flags, length and
 * data; time_us is not read.
 *
 * What is answered is gain * F/Fc, clamped to limit; at gain 1 and limit 1, as after dahl_node_init, the bits of the library.
 */
#ifndef DAHL_NODE_H
#define DAHL_NODE_H

#include <stdbool.h>
#include <stdint.h>

#include "dahl_can_bus.h"
#include "dahl.h"
#include "dahl_frames.h"
#include "dahl_parts.h"

#ifdef __cplusplus
extern "C" {
#endif

#define DAHL_NODE_TIMEOUT_US 100000u /* 100 frames; the 4-bit counter alone would see a gap only modulo 16 */
#define DAHL_NODE_STATUS_US 100000u  /* period of Status */
#define DAHL_NODE_GAP_MAX 3u         /* largest counter step that is used where no MaxStep is known: two frames missing */
#define DAHL_NODE_GAP_MAX_STEP 8u    /* the same where it is; larger steps look like frames that are late */
#define DAHL_NODE_REARM 3u           /* good frames in a row that are a new start, out of sequence or after a timeout */
#define DAHL_NODE_OFF_MAX 4u         /* bus-offs without an answer in between that are one too many */
#define DAHL_NODE_ONE 65536u         /* gain and limit of 1 */

/* Frames by what became of them, since dahl_node_init; lost counts frames that never came in time. */
typedef struct {
    uint32_t ok;
    uint32_t repeated;
    uint32_t lost;
    uint32_t wrong_sequence;
    uint32_t crc;
    uint32_t format;
    uint32_t invalid;
    uint32_t jump;
    uint32_t stale;
    uint32_t rearm;
    uint32_t ignored; /* other ids */
    uint32_t params;  /* ParamWrite frames that were good */
    uint32_t resets;
    uint32_t bus_off;
} dahl_node_counts_t;

/* The counts that Status shows, modulo 256. */
typedef struct {
    uint8_t lost;
    uint8_t corrupt;
    uint8_t out_of_step;
} dahl_node_tally_t;

/* A model that answers in place of the Dahl element: dahl_node_use_NAME sets one. */
typedef struct dahl_node_model {
    int32_t (*step_q30)(struct dahl_node_model *model, int32_t dcounts); /* torque over Fc after this move */
    void (*relax)(struct dahl_node_model *model);
    uint32_t kind;     /* what parameter Model says: DAHL_FRAMES_MODEL_* */
    uint32_t load_q30; /* of the next move, told by the node; for the model Loaded only */
} dahl_node_model_t;

typedef struct {
    dahl_plan_t plan;
    dahl_params_t params;
    dahl_params_t held;    /* params, and what was written to be held until the next write */
    dahl_state_t bearing;
    dahl_node_model_t *model; /* none: plan and bearing */
    dahl_node_counts_t counts;
    uint32_t gain;         /* of DAHL_NODE_ONE; this and the next six may be changed after dahl_node_init */
    uint32_t limit;        /* of DAHL_NODE_ONE; more is taken as 1, as in load */
    uint32_t load;         /* of DAHL_NODE_ONE: part of the load at which Fc holds; the model Loaded alone looks at it */
    uint32_t ramp_us;      /* the gain needs so long from 0 to 1; 0: none. A wait of more than 65 ms counts as 65 ms */
    uint32_t timeout_us;
    uint32_t max_step;     /* MaxStep, counts per ms; 0: no limit known */
    uint32_t status_us;    /* period of Status; 0: only after power-on, a timeout, a bus-off and a Reset */
    uint32_t gain_now;     /* on its way to gain */
    uint32_t gain_rest;    /* part of its next step, of ramp_us */
    uint32_t count;        /* of the last EncoderState accepted */
    uint32_t good_us;      /* when that was */
    uint32_t sent_us;      /* when Status was last sent */
    uint32_t bus_off_us;   /* when the last bus-off was */
    uint8_t number;        /* node number, 0..15 */
    uint8_t state;         /* dahl_frames_state_t */
    uint8_t errors;        /* sticky bits of Status */
    uint8_t counter;       /* of the last EncoderState in sequence */
    uint8_t good_in_a_row; /* frames, each with the next counter, that may be a new start */
    uint8_t candidate;     /* counter of the last of them */
    uint8_t bus_off_count; /* since the last answer */
    uint8_t torque_counter;
    uint8_t status_counter;
    dahl_node_tally_t cleared;  /* counts at the last Reset: Status shows what came after it */
    bool primed;           /* count and counter are a valid starting point */
    bool silenced;         /* the next starting point ends a silence: it is waited for */
    bool urgent;           /* Status is due now */
} dahl_node_t;

/* Start relaxed, waiting for the first frame. Node number 0..15; higher bits are cut. Fails as dahl_prepare does: then
 * *node is untouched. */
DAHL_NODISCARD dahl_err_t dahl_node_init(dahl_node_t *node, const dahl_params_t *params, uint8_t number);

/*
 * OTHER MODELS (dahl_parts.h), each in a file of its own, linked only when called. dahl_node_use_NAME, after dahl_node_init:
 * answer by that model, relaxed, from now on. What it keeps lives beside dahl_node_t, as long as the node. Parameter Model tells
 * the model, Fc, Sigma0 and ThetaPerCount read as said here, and writing these is refused with OutOfRange. Fails as
 * dahl_NAME_prepare does: then nothing is touched.
 */
typedef struct {
    dahl_node_model_t model;
    dahl_slip_plan_t plan;
    dahl_slip_state_t state;
} dahl_node_slip_t;

/* Slip elements. The ratio answered is of the sum of Fc; Fc and Sigma0 read as their sums. */
DAHL_NODISCARD dahl_err_t dahl_node_use_slip(dahl_node_t *node, dahl_node_slip_t *slip, const dahl_slip_params_t *params);

typedef struct {
    dahl_node_model_t model;
    dahl_asymmetric_plan_t plan;
    dahl_state_t state;
} dahl_node_asymmetric_t;

/* An Fc of each direction its own. The ratio answered is of the larger Fc, which Fc reads as. */
DAHL_NODISCARD dahl_err_t dahl_node_use_asymmetric(dahl_node_t *node, dahl_node_asymmetric_t *kept,
                                                   const dahl_asymmetric_params_t *params);

typedef struct {
    dahl_node_model_t model;
    dahl_elastoplastic_plan_t plan;
    dahl_state_t state;
} dahl_node_elastoplastic_t;

/* No creep below breakaway. */
DAHL_NODISCARD dahl_err_t dahl_node_use_elastoplastic(dahl_node_t *node, dahl_node_elastoplastic_t *kept,
                                                      const dahl_params_t *params, float breakaway);

typedef struct {
    dahl_node_model_t model;
    dahl_plan_t plan;
    dahl_loaded_state_t state;
} dahl_node_loaded_t;

/* Fc and sigma0 follow a load, which parameter Load tells: 1 after dahl_node_init, at most 1, and as it was last written. params
 * hold at load 1, and the ratio answered is of that Fc. */
DAHL_NODISCARD dahl_err_t dahl_node_use_loaded(dahl_node_t *node, dahl_node_loaded_t *kept, const dahl_params_t *params);

typedef struct {
    uint32_t elements;           /* 1 .. DAHL_SLIP_MAX */
    uint32_t slips;              /* bit k: element k slips; else it is one of Dahl's */
    float theta_per_count;       /* rad/count, not 0 */
    float sigma0[DAHL_SLIP_MAX]; /* N m/rad, of each element */
    float Fc[DAHL_SLIP_MAX];     /* N m */
} dahl_node_parallel_params_t;

typedef struct {
    dahl_node_model_t model;
    uint32_t bearings; /* elements of Dahl's */
    dahl_slip_plan_t slip;
    dahl_slip_state_t slip_state;
    uint64_t slip_share; /* of the sum of Fc, Q62 */
    dahl_plan_t plan[DAHL_SLIP_MAX];
    dahl_state_t state[DAHL_SLIP_MAX];
    uint64_t share[DAHL_SLIP_MAX];
} dahl_node_parallel_t;

/* Dahl and slip elements on one shaft. The ratio answered is of the sum of Fc; Fc and Sigma0 read as their sums. Its error is
 * 1e-9 beside those of the elements. Stack: 3 KiB, here only. */
DAHL_NODISCARD dahl_err_t dahl_node_use_parallel(dahl_node_t *node, dahl_node_parallel_t *kept,
                                                 const dahl_node_parallel_params_t *params);

/* The controller went off the bus, where that is not told by an error frame: dahl_node_receive takes those. */
void dahl_node_bus_off(dahl_node_t *node, uint32_t now_us);

/* Process one frame of any kind. True: *out is the answer to send at once. now_us, here and below, is one clock that may wrap
 * but must not go back from call to call. */
bool dahl_node_receive(dahl_node_t *node, const dahl_can_frame_t *in, uint32_t now_us, dahl_can_frame_t *out);

/* Check the clock, every millisecond or so: a timeout is detected at the next tick or good frame. After more than 35 minutes
 * without a tick an age may look short. True: *out is a Status frame to send; the first call gives one at once. */
bool dahl_node_tick(dahl_node_t *node, uint32_t now_us, dahl_can_frame_t *out);

#ifdef __cplusplus
}
#endif

#endif

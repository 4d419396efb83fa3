/* SPDX-License-Identifier: MIT */
/*
 * node: the friction node, the very file that the firmware links. Frames in, frames out; no I/O, no heap, no OS, no float.
 *
 *   static node_t node;
 *   node_init(&node, &plan, 0);
 *   on each frame:     if (node_receive(&node, &in, now_us, &out)) { send(&out); }
 *   every millisecond: if (node_tick(&node, now_us, &out)) { send(&out); }
 *
 * Every EncoderState that the node accepts is answered once, by a FrictionTorque with the torque after that count.
 * What it does with an EncoderState of its own number (the count is absolute, so travel needs no unbroken chain):
 *
 *   frame                                        state          torque                       answer
 *   first good one, or first after a timeout     INIT, STALE    kept: the count is the start yes
 *   counter + 1                                  OK             moved by the travel since    yes
 *   counter + 2, + 3 (one or two missing)        LOST           moved by the travel since    yes
 *   counter + 0                                  REPEATED       kept                         no
 *   any other counter                            WRONG_SEQUENCE kept                         no
 *     the second of two such in a row            WRONG_SEQUENCE kept: the count is the start yes
 *   not valid by its own flag                    unchanged      kept, sequence goes on       no
 *   wrong CRC, length, or not a classic frame    CRC            kept                         no
 *   nothing good for timeout_us                  STALE          kept                         -
 *
 * Counts that passed unseen in a gap are never integrated blindly: a jump of the encoder cannot become a torque.
 */
#ifndef NODE_H
#define NODE_H

#include <stdbool.h>
#include <stdint.h>

#include "can_bus.h"
#include "dahl.h"
#include "frames.h"

#ifdef __cplusplus
extern "C" {
#endif

#define NODE_TIMEOUT_US 100000u /* 100 frames; the 4-bit counter alone would see a gap only modulo 16 */
#define NODE_STATUS_US 100000u
#define NODE_GAP_MAX 3u /* largest counter step that is used: two frames missing */

/* Frames by what became of them; lost counts frames that never came. */
typedef struct {
    uint32_t ok;
    uint32_t repeated;
    uint32_t lost;
    uint32_t wrong_sequence;
    uint32_t crc;
    uint32_t format;
    uint32_t invalid;
    uint32_t stale;
    uint32_t ignored; /* other ids */
} node_counts_t;

typedef struct {
    const dahl_plan_t *plan;
    dahl_state_t bearing;
    node_counts_t counts;
    uint32_t timeout_us;   /* may be changed after node_init */
    uint32_t status_us;    /* period of Status; 0: none */
    uint32_t count;        /* of the last EncoderState accepted */
    uint32_t good_us;      /* when that was */
    uint32_t sent_us;      /* when Status was last sent */
    uint8_t number;        /* node number, 0..15 */
    uint8_t state;         /* frames_state_t */
    uint8_t start;         /* why the next good frame is a starting point: INIT or STALE */
    uint8_t errors;        /* sticky bits of Status */
    uint8_t counter;       /* of the last EncoderState in sequence */
    uint8_t candidate;     /* counter of a frame out of sequence that the next one may confirm */
    uint8_t torque_counter;
    uint8_t status_counter;
    bool primed;           /* count and counter are a valid starting point */
    bool doubtful;         /* candidate is set */
    bool greeted;          /* the first Status was sent */
} node_t;

/* Start relaxed, waiting for the first frame. Node number 0..15; higher bits are cut. *plan must outlive the node. */
void node_init(node_t *node, const dahl_plan_t *plan, uint8_t number);

/* Take one frame, any frame. True: *out is the answer to send at once. now_us may wrap. */
bool node_receive(node_t *node, const can_frame_t *in, uint32_t now_us, can_frame_t *out);

/* Look at the clock, every millisecond or so. True: *out is a Status frame to send; the first call gives one at once. */
bool node_tick(node_t *node, uint32_t now_us, can_frame_t *out);

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
/*
 * encoder: the side that streams angles. It sends one EncoderState per tick, and matches each FrictionTorque to the frame
 * that it echoes. A bus keeps the order, so an answer belongs to the oldest unanswered frame with the echoed counter, and
 * those before it are lost: that holds through a stall of either side, where more than 16 frames wait. After a real gap
 * the node says that it starts anew (INIT, STALE, WRONG_SEQUENCE); such an answer belongs to the newest one instead.
 */
#ifndef ENCODER_H
#define ENCODER_H

#include <stdbool.h>
#include <stdint.h>

#include "dahl_can_bus.h"
#include "faults.h"
#include "histogram.h"
#include "motion.h"

#define ENCODER_PERIOD_NS UINT64_C(1000000)
#define ENCODER_LOAD_TICKS 1000u /* after so many ticks the load is told again */
#define ENCODER_WAITING 1024u /* frames that can wait for an answer; older ones are lost */

typedef struct {
    motion_t *motion;
    uint8_t node; /* node number that it talks to */
    bool ended;  /* the motion has no more counts */
    bool failed; /* the motion failed; the error was printed */
    uint64_t sent;     /* frames; also the sequence number of the next */
    uint64_t next;     /* sequence number of the oldest frame that may still be answered */
    uint64_t answered;
    uint64_t unmatched; /* answers to nothing that waits: late, doubled or foreign */
    uint64_t corrupt;   /* answers with wrong CRC or form */
    uint64_t sent_ns[ENCODER_WAITING]; /* by sequence number */
    uint64_t late;      /* answers that took longer than a period */
    uint64_t last_ns;   /* latency of the last answer */
    int32_t torque_q30; /* of the last answer */
    uint64_t torque_of; /* sequence number of the frame that it answers, plus 1 */
    const scene_load_t *load; /* what the node's friction follows; NULL: none */
    uint32_t load_told;       /* of DAHL_NODE_ONE: what the node knows */
    uint64_t loads;           /* times that it was told */
    faults_t *faults;   /* what meets its frames on their way; NULL: nothing */
    histogram_t latency;
    histogram_t jitter; /* change of the latency from one answer to the next */
} encoder_t;

/* True: *out is to be sent now. False: the motion has ended or failed. */
bool encoder_tick(encoder_t *encoder, uint64_t now_ns, dahl_can_frame_t *out);

/* True: *out tells the node the load of the tick that was just made, and goes before its angle. False: it has not changed. It is
 * told again every ENCODER_LOAD_TICKS, for a node that missed it or was switched on anew. */
bool encoder_load(encoder_t *encoder, dahl_can_frame_t *out);

static inline bool encoder_waits(const encoder_t *encoder)
{
    return encoder->next < encoder->sent;
}

/* No longer wait for what was not answered: it is lost. */
static inline void encoder_give_up(encoder_t *encoder)
{
    encoder->next = encoder->sent;
}

/* Take any frame; all but the node's FrictionTorque are none of its business. */
void encoder_receive(encoder_t *encoder, const dahl_can_frame_t *in, uint64_t now_ns);

#endif

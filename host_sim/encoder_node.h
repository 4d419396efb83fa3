/* SPDX-License-Identifier: MIT */
/*
 * encoder_node: send one EncoderState each tick, and match each FrictionTorque to the frame that it echoes.
 *
 * A bus keeps the order. Thus an answer belongs to the oldest waiting frame with the echoed counter, and the frames before that
 * one stay unanswered. This also holds if more than 16 frames wait because either side stalled. After missing frames the node
 * may report a new start (INIT, STALE, WRONG_SEQUENCE). Such an answer belongs to the newest frame with the echoed counter.
 */
#ifndef ENCODER_NODE_H
#define ENCODER_NODE_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "dahl_can_bus.h"
#include "faults.h"
#include "histogram.h"
#include "motion.h"

#define ENCODER_LOAD_TICKS 1000u /* the load is sent again after this many ticks */
#define ENCODER_WAITING 1024u    /* frames that can wait for an answer; older ones are unanswered */

typedef struct {
    motion_t *motion;
    uint8_t node;       /* number of its node */
    bool has_ended;     /* the motion has no more counts */
    bool has_failed;    /* the motion failed; the error was printed */
    uint64_t sent;      /* frames; also the sequence number of the next */
    uint64_t next;      /* sequence number of the oldest frame that may still be answered */
    uint64_t answered;
    uint64_t unmatched; /* answers to no waiting frame: late, repeated or foreign */
    uint64_t corrupt;   /* answers with a wrong CRC or form */
    uint64_t sent_ns[ENCODER_WAITING]; /* by sequence number */
    uint64_t late;      /* answers with a latency above one period */
    uint64_t last_ns;   /* latency of the last answer */
    int32_t torque_q30; /* of the last answer */
    uint64_t torque_of; /* sequence number of the frame that it answers, plus 1 */
    const run_load_t *load; /* of the node's friction; NULL: constant */
    uint32_t load_sent;       /* last value sent, of DAHL_NODE_ONE */
    uint64_t loads;           /* load frames sent */
    faults_t *faults;         /* faults of its frames on the bus; NULL: without */
    histogram_t latency;
    histogram_t jitter; /* change of the latency from one answer to the next */
} encoder_t;

/* True: send *out now. False: the motion has ended or failed. */
bool encoder_tick(encoder_t *encoder, uint64_t now_ns, dahl_can_frame_t *out);

/* Load of a bearing in the unit of parameter Load, 1/DAHL_NODE_ONE: min(limit, rest + |x|/full), x in the unit of full. */
static inline uint32_t encoder_load_of(const run_load_t *load, double x, double limit)
{
    return (uint32_t)lround(fmin(limit, load->rest + fabs(x) / load->full) * DAHL_NODE_ONE);
}

/* True: send *out, the load of the last tick, before the count of that tick. False: the load has not changed. It is sent again
 * each ENCODER_LOAD_TICKS, for a node that lost it or restarted. */
bool encoder_load(encoder_t *encoder, dahl_can_frame_t *out);

static inline bool encoder_waits(const encoder_t *encoder)
{
    return encoder->next < encoder->sent;
}

/* Stop waiting for an answer to the frames that were sent. */
static inline void encoder_give_up(encoder_t *encoder)
{
    encoder->next = encoder->sent;
}

/* Process a FrictionTorque of its node. Other frames are ignored. */
void encoder_receive(encoder_t *encoder, const dahl_can_frame_t *in, uint64_t now_ns);

#endif

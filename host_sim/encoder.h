/* SPDX-License-Identifier: MIT */
/*
 * encoder: the side that streams angles. It sends one EncoderState per tick, and matches each FrictionTorque to the frame
 * that it echoes; what is not answered before its counter comes round again (16 ticks) is lost.
 */
#ifndef ENCODER_H
#define ENCODER_H

#include <stdbool.h>
#include <stdint.h>

#include "can_bus.h"
#include "histogram.h"
#include "motion.h"

typedef struct {
    motion_t *motion;
    uint8_t node; /* node number that it talks to */
    uint8_t counter;
    bool ended;  /* the motion has no more counts */
    bool failed; /* the motion failed; the error was printed */
    uint16_t open; /* bit c: the frame with counter c waits for its answer */
    uint64_t sent_ns[16];
    uint64_t sent, answered;
    uint64_t unmatched; /* answers to nothing that waits: late, doubled or foreign */
    uint64_t corrupt;   /* answers with wrong CRC or form */
    histogram_t latency;
} encoder_t;

/* True: *out is to be sent now. False: the motion has ended or failed. */
bool encoder_tick(encoder_t *encoder, uint64_t now_ns, can_frame_t *out);

/* Take any frame; all but the node's FrictionTorque are none of its business. */
void encoder_receive(encoder_t *encoder, const can_frame_t *in, uint64_t now_ns);

#endif

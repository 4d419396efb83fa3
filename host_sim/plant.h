/* SPDX-License-Identifier: MIT */
/*
 * plant: a rotor with its motor, as a motion. Each tick advances it by one period. It is driven by one of
 *
 *   [motor]    a torque over time, bias + amplitude sin(2 pi frequency t). The encoder sends the angle of the shaft.
 *   [control]  a PD controller on the encoder's counts, which follows the motion, plus the friction torque that the
 *              node answers. The encoder sends the *reference*: feed-forward on the reference angle has no feedback, so it
 *              cannot chatter. The torque counts as 0 if the last answer is 3 ticks old or older.
 *
 * With either, a [hand] may also act on the shaft.
 */
#ifndef PLANT_H
#define PLANT_H

#include <stdio.h>

#include "controller.h"
#include "encoder_node.h"
#include "motion.h"
#include "rotor.h"
#include "run_file.h"

typedef struct {
    motion_t motion; /* first, so that a motion_t * is a plant_t *; the encoder reads it */
    const run_t *run;
    motion_t *reference;      /* NULL: [motor] */
    const encoder_t *encoder; /* with the last answer */
    double Fc;                /* N m, torque of an answer of 1 */
    FILE *trace;              /* NULL: not written */
    int trace_errno;          /* of a failed row; 0: all are written */
    rotor_t rotor;
    controller_t controller; /* of the error in counts */
    uint64_t ticks;
    double torque;       /* of the motor, N m */
    int side;            /* sign of the last nonzero torque */
    double compensation; /* part of the torque that the node computed */
    double rate;         /* of the error, counts per ms, filtered */
    double last_error;   /* counts */
    int64_t reference_count;
    int direction;       /* of the reference */
    double sum_square;   /* of the tracking error, rad^2 */
    double max_error;    /* rad */
    uint64_t alternations; /* of the sign of the motor's torque */
    uint64_t reversals;    /* of the reference */
} plant_t;

/* reference: an open motion, or NULL for [motor]. Fc: of the node. False: one error line was printed. */
bool plant_open(plant_t *plant, const run_t *run, motion_t *reference, const encoder_t *encoder, float Fc);

/* Open the trace: a CSV row of time, angles, velocity and torques for each tick. Returns false with errno set on failure. */
bool plant_trace(plant_t *plant, const char *path);

/* Close the trace. Returns false with errno set if a row could not be written. */
bool plant_close(plant_t *plant);

#endif

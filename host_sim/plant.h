/* SPDX-License-Identifier: MIT */
/*
 * plant: a rotor with its motor, as a motion like any other: each tick moves it by a millisecond. Two ways to drive it:
 *
 *   [motor]    a torque over time, bias + amplitude sin(2 pi frequency t); the encoder streams where the shaft is
 *   [control]  the motor follows the scene's [motion] by a PD controller on the encoder's counts, and adds the friction
 *              torque that the node answers. The encoder streams the *reference*: feed-forward on the reference angle
 *              has no feedback, so it cannot chatter. An answer that is older than 3 ticks counts as 0.
 */
#ifndef PLANT_H
#define PLANT_H

#include <stdio.h>

#include "encoder.h"
#include "motion.h"
#include "rotor.h"
#include "scene.h"

typedef struct {
    motion_t motion; /* first: what the encoder sees */
    const scene_t *scene;
    motion_t *reference;      /* NULL: [motor] */
    const encoder_t *encoder; /* whose answers are added */
    FILE *trace;              /* NULL: none */
    int trace_errno;          /* why a row of it could not be written; 0: all are */
    rotor_t rotor;
    uint64_t ticks;
    double torque;       /* of the motor, N m */
    int side;            /* sign of the last torque that was not 0 */
    double compensation; /* part of it that the node computed */
    double rate;         /* of the error, counts per ms, filtered */
    double last_error;   /* counts */
    int64_t place;       /* reference, counts */
    int direction;       /* of the reference */
    double sum_square;   /* of the tracking error, rad^2 */
    double max_error;    /* rad */
    uint64_t alternations; /* of the sign of the motor's torque */
    uint64_t reversals;    /* of the reference */
} plant_t;

/* reference: an open motion, NULL for [motor]. False: one error line was printed. */
bool plant_open(plant_t *plant, const scene_t *scene, motion_t *reference, const encoder_t *encoder);

/* Write time, reference, angle, velocity, motor, friction, compensation of each tick as CSV. False: errno says why. */
bool plant_trace(plant_t *plant, const char *path);

/* Close the trace that was asked for. False: it could not be written whole, and errno says why. */
bool plant_close(plant_t *plant);

#endif

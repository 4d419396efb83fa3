/* SPDX-License-Identifier: MIT */
/*
 * motion: what the shaft does, one count per tick of 1 ms. The built-in kinds use only + - * / and rounding, so that the
 * same seed gives the same counts on every machine.
 *
 *   segments  the three of the paper: 0 to theta1, back to theta2, on to theta3, at constant speed, resting hold_s between
 *   steering  slow sweeps between seeded targets as in parking, with small seeded reversals (tremor) on top
 *   log       a column of a measured file, one row per tick
 */
#ifndef MOTION_H
#define MOTION_H

#include <stdbool.h>
#include <stdint.h>

#include "recording.h"
#include "scene.h"

typedef struct motion motion_t;

/* A smooth move from one place to another over some ticks. */
typedef struct {
    double from, to;
    uint64_t tick, ticks;
} motion_move_t;

struct motion {
    int (*next)(motion_t *self, int64_t *place); /* 1, 0 at the end, -1 after an error */
    const scene_motion_t *scene;
    uint64_t random;
    uint64_t tick, ticks;
    uint64_t hold; /* ticks still to rest */
    int leg;
    double side;
    motion_move_t sweep;
    double bump;                      /* height of the present tremor */
    uint64_t bump_tick, bump_ticks;   /* bump_ticks 0: between two tremors, until bump_tick is 0 */
    double load;                      /* of this tick, in the unit of the log's column, or N m of a motor */
    recording_t recording;
};

/* path: of the log file, used by kind = log only; load: its column of a load, "" for none. False: one error line was printed. */
bool motion_open(motion_t *self, const scene_motion_t *scene, const char *path, const char *load, uint64_t seed);

/* The count of the next tick, modulo 2^32: 1; the end: 0; an error, printed: -1. */
int motion_next(motion_t *self, int32_t *count);

void motion_close(motion_t *self);

#endif

/* SPDX-License-Identifier: MIT */
/*
 * motion: the shaft's angle, one count each tick. The built-in kinds use only + - * / and rounding, so that the same seed gives
 * the same counts on every machine.
 *
 *   segments  the three of the paper at constant speed: 0 to theta1, back to theta2, to theta3, each after a rest of hold_s
 *   steering  slow sweeps between random targets, as in parking, with small random reversals (tremor)
 *   counts    a file with a line for each tick: the encoder's count and, if the friction has a load, its x. It is read line by
 *             line, so that memory does not grow with it; it may be a pipe.
 */
#ifndef MOTION_H
#define MOTION_H

#include <stdbool.h>
#include <stdint.h>

#include "lines.h"
#include "run_file.h"

typedef struct motion motion_t;

/* A smooth move between two angles. */
typedef struct {
    double from, to;
    uint64_t tick, ticks;
} motion_move_t;

struct motion {
    int (*next)(motion_t *self, int64_t *count); /* 1, 0 at the end, -1 after an error */
    const run_motion_t *run;
    uint64_t random;
    uint64_t tick, ticks;
    uint64_t hold; /* ticks left to rest */
    int leg;
    double side;
    motion_move_t sweep;
    double bump;                      /* amplitude of the present tremor, counts */
    uint64_t bump_tick, bump_ticks;   /* if bump_ticks is 0: bump_tick counts down to the next tremor */
    double load;                      /* of this tick, x in the file of counts, or N m of a motor */
    lines_t counts; /* of kind counts */
};

/* path: of the file of kind counts. False: one error line was printed. */
bool motion_open(motion_t *self, const run_motion_t *run, const char *path, uint64_t seed);

/* Return 1 and the count of the next tick, modulo 2^32; 0 at the end; -1 after one error line. */
int motion_next(motion_t *self, int32_t *count);

void motion_close(motion_t *self);

#endif

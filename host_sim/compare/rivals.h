/* SPDX-License-Identifier: MIT */
/*
 * rivals: usual laws of friction compensation, to compare with. They are written to be read, in double precision. Each has one
 * knob, which tune() of tools/dahl/sim/compensation.py sets.
 */
#ifndef RIVALS_H
#define RIVALS_H

#include <stdint.h>

typedef enum {
    DAHL_LAW_NONE,
    DAHL_LAW_SIGN,
    DAHL_LAW_TANH,
    DAHL_LAW_DEAD_BAND,
    DAHL_LAW_REVERSAL,
    DAHL_LAW_LUGRE,
    DAHL_LAW_DISTURBANCE,
    DAHL_LAW_LEARNED,
    DAHL_LAW_DAHL,          /* of the library, as the next one */
    DAHL_LAW_DAHL_OBSERVER
} law_t;

/* Friction and axis as a law assumes them. */
typedef struct {
    law_t law;
    double knob;                /* its meaning stands at each law */
    double sigma0, Fc;          /* N m/rad, N m */
    double breakaway, stribeck; /* N m, rad/s; breakaway = Fc: no Stribeck effect */
    double inertia;             /* kg m2 */
    double speed_gain;          /* N m s/rad, of the loop */
    double theta_per_count;     /* rad */
    uint32_t noise, delay;      /* counts; ticks, below 4 */
    int is_hand;                /* without a position loop: no reference */
    int has_integral;           /* the loop has one */
} law_params_t;

/* All that a law may read in a tick. */
typedef struct {
    double target_speed;  /* rad/s, of the reference */
    int32_t target_move;  /* counts of the reference since the last tick */
    int32_t dcounts;      /* counts of the encoder since the last tick */
    double speed;         /* rad/s, from the counts, behind the low-pass of the loop */
    double acted;         /* N m, of the motor since the last tick */
    double learned;       /* N m, from a table of this tick */
} reading_t;

/* All zeros: at rest. */
typedef struct {
    double speed;         /* rad/s, behind a low-pass */
    double torque;        /* N m, of the reversal rule */
    double bristle_speed; /* rad/s, of the LuGre observer */
    double deflection;    /* rad, of its bristle */
    double raw, filtered; /* N m, of the disturbance observer */
    int32_t dcounts;
} rival_t;

/* Return the torque in N m to add to the command. Call it once in a tick. */
double dahl_rival_torque(const law_params_t *law, rival_t *rival, const reading_t *now);

#endif

/* SPDX-License-Identifier: MIT */
/** Helpers that the stages share. Each stage is one file: rest, sweeps, cycle, breakaway, inertia, kick. */
#ifndef DAHL_COMMISSION_INTERNAL_H
#define DAHL_COMMISSION_INTERNAL_H

#include "dahl_commission.h"

#define AXIS_TWO_PI 6.28318531f
#define BINS DAHL_COMMISSION_BINS
/** Largest part of Fc_low - load that the compensator may cancel, rounded down. */
#define COMMISSION_MAX_GAIN (0.95f * (1 - 1e-6f))
/** Directions of a LuGre or worn axis differ by at most this part of Fc. */
#define UNEQUAL_SHARE 0.15f
/** [rad] If the load moves the axis by this at rest, the loop holds it. */
#define FALL_RAD 0.02f

static inline float dahl_absolute(float x)
{
    return x < 0 ? -x : x;
}

static inline float dahl_smaller(float x, float y)
{
    return x < y ? x : y;
}

static inline float dahl_larger(float x, float y)
{
    return x > y ? x : y;
}

/** Return x within +-limit. */
static inline float dahl_axis_clamp(float x, float limit)
{
    return x > limit ? limit : x < -limit ? -limit : x;
}

/** Return the ticks of a time. */
static inline uint32_t dahl_ticks(const dahl_commission_t *axis, float seconds)
{
    return (uint32_t)(seconds / axis->config.period + 0.5f);
}

/** Return 1 if `ticks` are more than those of a time. It takes no division, because some checks run in each tick. */
static inline int dahl_is_longer(const dahl_commission_t *axis, uint32_t ticks, float seconds)
{
    return ((float)ticks - 0.5f) * axis->config.period > seconds;
}

/** Return the square root by Newton's steps; 0 if x is not positive. */
float dahl_root(float x);
/** Write cosine and sine of an angle below 1. */
void dahl_small_turn(float angle, float turn[2]);
/** Turn a unit vector. Its length stays 1. */
void dahl_rotate(float rotor[2], const float turn[2]);
/** Return the share by which a first-order low-pass moves in a tick (backward Euler). */
float dahl_low_pass_share(float hertz, float period);

/* Flow */
void dahl_refuse(dahl_commission_t *axis, dahl_commission_refusal_t why);
void dahl_enter(dahl_commission_t *axis, dahl_commission_stage_t stage);
void dahl_next_step(dahl_commission_t *axis);

/* Reference */
void dahl_track_from_here(dahl_commission_t *axis);
void dahl_stroke_to(dahl_commission_t *axis, float end, float speed, float acceleration);
/** One tick of the stroke. Return 1 at its end. */
int dahl_stroke_tick(dahl_commission_t *axis);
/** Go to the middle, then wait without the loop. Return 1 at the end. */
int dahl_wait_in_middle(dahl_commission_t *axis, float seconds);
/** Start the way back to the middle. */
void dahl_return_to_middle(dahl_commission_t *axis);

/** Write the parameters of the compensator without a check. */
void dahl_write_params(const dahl_commission_t *axis, dahl_compensator_params_t *params, int has_load);

void dahl_supervise(dahl_commission_t *axis, int32_t dcounts);

/* Stages */
void dahl_rest_tick(dahl_commission_t *axis);
void dahl_sweeps_tick(dahl_commission_t *axis);
void dahl_cycle_tick(dahl_commission_t *axis);
void dahl_breakaway_tick(dahl_commission_t *axis);
void dahl_inertia_tick(dahl_commission_t *axis, int32_t dcounts);
void dahl_kick_tick(dahl_commission_t *axis, int32_t dcounts);

#endif

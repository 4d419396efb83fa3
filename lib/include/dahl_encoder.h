/* SPDX-License-Identifier: MIT */
/*
 * dahl_encoder: from the readings of an encoder's counter to the counts of each tick, wherever the counter wraps.
 *
 * USE
 *   static dahl_encoder_t encoder;                              // all zeros: never moves
 *   if (dahl_encoder_init(&encoder, 65536, +1, 1000) != DAHL_OK) { stop(); }
 *   each tick:  F = dahl_step_counts(&plan, &bearing, dahl_encoder_move(&encoder, TIM3->CNT));
 *
 * THE MODULUS is that of the reading: the number of values it has before it starts again. That is seldom a turn:
 *   65536 for a 16-bit timer, 0 for a 32-bit timer, the counts per turn for an absolute encoder or a timer that reloads.
 * A JUMP  A move larger than largest_step is none that the shaft can make in one tick: the counter was reset by its index
 *   pulse, or a reading was spoiled. It counts as no motion and is told in `jumps`; the next move starts at the new
 *   reading. So a jump is never integrated, and what the shaft moved in that tick is lost.
 *
 * docs/encoder.md: quadrature, index pulses, velocities, and angles as float.
 */
#ifndef DAHL_ENCODER_H
#define DAHL_ENCODER_H

#include "dahl.h"

/* A function that each caller compiles into its own code. The library has it once more, as `extern inline`, for other languages. */
#if defined(__GNUC_GNU_INLINE__) && !defined(__cplusplus) /* where these words mean the opposite of what C99 says */
#define DAHL_ENCODER_INLINE extern inline
#elif !defined(DAHL_ENCODER_INLINE)
#define DAHL_ENCODER_INLINE inline
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* One counter. Belongs to its caller; one call at a time. All zeros, or what dahl_encoder_init and the other calls left. */
typedef struct {
    uint32_t last;         /* reading */
    uint32_t scale;        /* sign 2^shift: at this scale the reading wraps where a word of 32 bits does */
    uint32_t shift;        /* 32 less the bits of the reading */
    uint32_t reach;        /* shorter moves need no further question; 0: every move does */
    uint32_t modulus;      /* of the reading; 0: all 32 bits */
    uint32_t largest_step; /* counts that can be motion between two readings; 0: any */
    uint32_t jumps;        /* moves refused since dahl_encoder_init; stops at its largest value */
    int8_t sign;           /* of the mounting: +1, -1; 0: not initialised */
    uint8_t primed;        /* 1: `last` holds a reading, of an encoder that was initialised */
} dahl_encoder_t;

/* Describe the counter. sign is -1 where it counts down while the shaft turns forward, else +1. largest_step is the most
 * counts that the shaft can turn between two readings; 0: no limit.
 * Fails with DAHL_ERR_PARAM iff sign is neither; with DAHL_ERR_RANGE iff modulus is 1 or 2 (two values tell no direction)
 * or largest_step >= modulus/2, the exact half: of a modulus of 11, 5 is accepted. Then *encoder is untouched. */
DAHL_NODISCARD dahl_err_t dahl_encoder_init(dahl_encoder_t *encoder, uint32_t modulus, int sign, uint32_t largest_step);

/* The counter was set to `reading` without motion, as by homing. The next move starts there. */
void dahl_encoder_home(dahl_encoder_t *encoder, uint32_t reading);

/* The moves that dahl_encoder_move() leaves to the library: the first one, one as long as largest_step or longer, and every
 * one by a modulus that is no power of two. For dahl_encoder_move() alone. */
int32_t dahl_encoder_rare_move(dahl_encoder_t *encoder, uint32_t reading);

/* The counts since the last reading, the shortest way (half of the modulus is taken as negative). Any reading is
 * accepted, and taken modulo. 0 for the first reading, for a jump, and where the encoder was not initialised.
 * Cost on Cortex-M, inline: 11 instructions where the modulus is a power of two, as that of each timer of 16 or 32 bits. */
DAHL_ENCODER_INLINE int32_t dahl_encoder_move(dahl_encoder_t *encoder, uint32_t reading)
{
    int32_t move = (int32_t)((reading - encoder->last) * encoder->scale) >> encoder->shift;
    if ((uint32_t)(move ^ move >> 31) < encoder->reach) { /* -reach <= move < reach */
        encoder->last = reading;
        return move;
    }
    return dahl_encoder_rare_move(encoder, reading);
}

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
/**
 * @file dahl_encoder.h
 * @brief Convert the readings of an encoder counter to the counts of each tick.
 *
 * Use it if the counter wraps, counts backward, or may jump.
 *
 * @par Use
 * @code{.c}
 *   static dahl_encoder_t encoder;                              // all zeros: never moves
 *   if (dahl_encoder_init(&encoder, 65536, +1, 1000) != DAHL_OK) { stop(); }
 *   F = dahl_step_counts(&plan, &bearing, dahl_encoder_move(&encoder, TIM3->CNT)); // each tick
 * @endcode
 *
 * The modulus is the number of values of the reading, which is seldom one turn: 65536 for a 16-bit
 * timer, 0 for a 32-bit timer, the counts per turn for an absolute encoder or a timer that reloads.
 *
 * @par Wrong readings
 * A move larger than largest_step is rejected as a jump: it returns 0 and increments `jumps`. The
 * next reading counts as a first one, so that the way back from a wrong reading is no motion. A
 * jump loses the motion of two ticks.
 * - If you know that a reading is bad (CRC, timeout, lost magnet), do not call dahl_encoder_move()
 *   in that tick. The next move covers both ticks; largest_step must allow it.
 * - In front of a compensator, pass largest_step 0, because its `jump` rejects the same moves and
 *   fades out. Report a bad reading to dahl_compensator_move(): it uses no move from or to a
 *   rejected reading.
 *
 * @par Interrupts
 * If a tick runs between the code that sets the counter and dahl_encoder_home(), it takes the new
 * count as motion. Mask the interrupt of the tick around both. docs/encoder.md has the code.
 *
 * docs/encoder.md covers quadrature, index pulses, velocities, and angles as float.
 */
#ifndef DAHL_ENCODER_H
#define DAHL_ENCODER_H

#include "dahl.h"

/** Linkage of an inline function. The library also has it as `extern inline`, for other languages.
 * Under gnu89 rules, the keywords have the opposite meaning. */
#if defined(__GNUC_GNU_INLINE__) && !defined(__cplusplus)
#define DAHL_ENCODER_INLINE extern inline
#elif !defined(DAHL_ENCODER_INLINE)
#define DAHL_ENCODER_INLINE inline
#endif

#ifdef __cplusplus
extern "C" {
#endif

/** State of one counter. It belongs to its caller: one call at a time. Start with all zeros. */
typedef struct {
    uint32_t last;         /**< last reading */
    uint32_t scale;        /**< sign 2^shift; scaled readings wrap at 32 bits */
    uint32_t shift;        /**< 32 minus the number of bits of the reading */
    uint32_t reach;        /**< [counts] shorter moves need no further check; 0: all moves need
                                it */
    uint32_t modulus;      /**< number of values of the reading; 0: 2^32 */
    uint32_t largest_step; /**< [counts] largest move that is no jump; 0: no limit */
    uint32_t jumps;        /**< jumps since dahl_encoder_init(); stops at UINT32_MAX */
    int8_t sign;           /**< +1 or -1; 0: not initialized */
    uint8_t primed;        /**< 1: the next move starts at `last`; 0: at the next reading */
} dahl_encoder_t;

/**
 * Describe the counter.
 * @param[out] encoder      encoder to initialize; unchanged if the call fails
 * @param      modulus      number of values of the reading; 0: 2^32
 * @param      sign         +1, or -1 if the counter counts down while the shaft turns forward
 * @param      largest_step [counts] largest move of the shaft between two readings; 0: no limit
 * @return #DAHL_OK; #DAHL_ERR_PARAM if sign is neither +1 nor -1; #DAHL_ERR_RANGE if modulus is 1
 *   or 2 (two values show no direction), or if largest_step >= modulus/2. The half is exact: for
 *   modulus 11, largest_step 5 is accepted.
 */
DAHL_NODISCARD dahl_err_t dahl_encoder_init(dahl_encoder_t *encoder, uint32_t modulus, int sign,
                                            uint32_t largest_step);

/**
 * Set the starting point of the next move, if the counter was set without motion, as by homing. No
 * tick may run since the counter was set: mask its interrupt around both.
 * @param encoder encoder
 * @param reading [counts] value to which the counter was set
 */
void dahl_encoder_home(dahl_encoder_t *encoder, uint32_t reading);

/** Moves that dahl_encoder_move() does not compute inline: the first, one of largest_step or more,
 * and all if the modulus is not a power of two. Call dahl_encoder_move() instead. */
int32_t dahl_encoder_rare_move(dahl_encoder_t *encoder, uint32_t reading);

/**
 * Return the shortest move since the last reading.
 * @param encoder encoder
 * @param reading [counts] present reading, modulo the modulus
 * @return [counts] signed move; half a modulus counts as negative. 0 for the first reading, for a
 *   jump and the reading after it, and if the encoder is not initialized.
 * @note It is inline if the modulus is a power of two, as for a 16-bit or 32-bit timer.
 */
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

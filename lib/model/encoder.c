/* SPDX-License-Identifier: MIT */
/** Encoder counter: wrap, direction and jumps. All that can be prepared is computed here, so that the inline move
 * of dahl_encoder.h is one difference, one product with `scale` and one comparison with `reach`. */
#define DAHL_ENCODER_INLINE extern inline /* emit the inline move here once, for callers from other languages */
#include "dahl_encoder.h"

#include "../arith/compiler.h"
#include "shortest_move.h"

static uint32_t half_of(uint32_t modulus)
{
    return modulus == 0 ? (uint32_t)1 << 31 : modulus / 2;
}

static int is_power_of_two(uint32_t modulus) /* true for 2^32 too, which is written as 0 */
{
    return (modulus & (modulus - 1)) == 0;
}

/** Return the shift that makes the reading wrap at 32 bits; 0 if the modulus is not a power of two. */
static uint32_t shift_of(uint32_t modulus)
{
    uint32_t shift = 0;
    for (; is_power_of_two(modulus) && modulus != 0; modulus <<= 1) {
        shift++;
    }
    return shift;
}

DAHL_COLD dahl_err_t dahl_encoder_init(dahl_encoder_t *encoder, uint32_t modulus, int sign, uint32_t largest_step)
{
    if (sign != 1 && sign != -1) {
        return DAHL_ERR_PARAM;
    }
    const uint32_t most = (modulus - 1) / 2; /* largest integer below modulus/2; a modulus of 0 is 2^32 */
    if (modulus == 1 || modulus == 2 || largest_step > most) {
        return DAHL_ERR_RANGE;
    }
    encoder->last = 0;
    encoder->shift = shift_of(modulus);
    encoder->scale = (uint32_t)sign << encoder->shift;
    encoder->reach = 0;
    encoder->modulus = modulus;
    encoder->largest_step = largest_step;
    encoder->jumps = 0;
    encoder->sign = (int8_t)sign;
    encoder->primed = 0;
    return DAHL_OK;
}

void dahl_encoder_home(dahl_encoder_t *encoder, uint32_t reading)
{
    encoder->last = reading;
    encoder->primed = encoder->sign != 0;
    if (encoder->primed && is_power_of_two(encoder->modulus)) {
        encoder->reach = encoder->largest_step != 0 ? encoder->largest_step : half_of(encoder->modulus);
    }
}

static int is_encoder_jump(const dahl_encoder_t *encoder, int32_t move)
{
    uint32_t distance = move < 0 ? 0u - (uint32_t)move : (uint32_t)move;
    return distance > encoder->largest_step && encoder->largest_step != 0;
}

/** The next reading is a first one: the way back from a wrong reading may be shorter than largest_step. */
static int32_t drop_jump(dahl_encoder_t *encoder)
{
    encoder->jumps += encoder->jumps != UINT32_MAX;
    encoder->primed = 0;
    encoder->reach = 0; /* no move is inline */
    return 0;
}

int32_t dahl_encoder_rare_move(dahl_encoder_t *encoder, uint32_t reading)
{
    uint32_t before = encoder->last, now = reading;
    if (!encoder->primed) {
        dahl_encoder_home(encoder, reading);
        return 0;
    }
    encoder->last = reading;
    if (encoder->sign < 0) { /* swap instead of negating the move, since -INT32_MIN overflows */
        now = before;
        before = reading;
    }
    int32_t move = dahl_shortest_move(before, now, encoder->modulus);
    return is_encoder_jump(encoder, move) ? drop_jump(encoder) : move;
}

/* SPDX-License-Identifier: MIT */
/* An encoder's counter: where it wraps, which way it runs, and what is too far for one tick. */
#include "dahl_encoder.h"

dahl_err_t dahl_encoder_init(dahl_encoder_t *encoder, uint32_t modulus, int sign, uint32_t largest_step)
{
    uint32_t half = modulus == 0 ? (uint32_t)1 << 31 : modulus / 2;
    if (sign != 1 && sign != -1) {
        return DAHL_ERR_PARAM;
    }
    if (modulus == 1 || modulus == 2 || largest_step >= half) {
        return DAHL_ERR_RANGE;
    }
    encoder->modulus = modulus;
    encoder->largest_step = largest_step;
    encoder->last = 0;
    encoder->jumps = 0;
    encoder->sign = (int8_t)sign;
    encoder->primed = 0;
    return DAHL_OK;
}

void dahl_encoder_home(dahl_encoder_t *encoder, uint32_t reading)
{
    encoder->last = reading;
    encoder->primed = 1;
}

static int is_jump(const dahl_encoder_t *encoder, int32_t move)
{
    uint32_t distance = move < 0 ? 0u - (uint32_t)move : (uint32_t)move;
    return encoder->largest_step != 0 && distance > encoder->largest_step;
}

int32_t dahl_encoder_move(dahl_encoder_t *encoder, uint32_t reading)
{
    uint32_t last = encoder->last;
    int known = encoder->primed && encoder->sign != 0;
    dahl_encoder_home(encoder, reading);
    if (!known) {
        return 0;
    }
    /* Read the other way round rather than negated, which the lowest count does not allow. */
    int32_t move = encoder->sign > 0 ? dahl_counts_between(last, reading, encoder->modulus)
                                     : dahl_counts_between(reading, last, encoder->modulus);
    if (is_jump(encoder, move)) {
        encoder->jumps += encoder->jumps != UINT32_MAX;
        return 0;
    }
    return move;
}

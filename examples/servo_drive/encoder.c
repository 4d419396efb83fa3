/* SPDX-License-Identifier: MIT */
#include "encoder.h"

#include <dahl.h>

enum { POLYNOMIAL = 0x97, ERROR_FREE = 0x02 /* in byte 2; a warning is no error */ };

static uint8_t crc8(const uint8_t *bytes, uint32_t length)
{
    uint32_t crc = 0;
    for (uint32_t k = 0; k < length; k++) {
        crc ^= bytes[k];
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc << 1) ^ ((crc & 0x80u) != 0 ? 0x100u | POLYNOMIAL : 0u);
        }
    }
    return (uint8_t)~crc;
}

/* The shaft may have moved on in the ticks of bad readings. */
static bool is_jump(const encoder_t *encoder, int32_t move)
{
    int64_t most = (int64_t)ENCODER_MAX_STEP * ((int64_t)encoder->bad_ticks + 1);
    return encoder->is_primed && (move > most || move < -most);
}

static int32_t reject(encoder_t *encoder, uint32_t *reason)
{
    encoder->bad_ticks++;
    encoder->good_ticks = 0;
    (*reason)++;
    return 0;
}

int32_t encoder_take(encoder_t *encoder, const uint8_t frame[4])
{
    uint32_t reading = (uint32_t)frame[0] << 8 | frame[1];
    int32_t move = dahl_counts_between(encoder->reading, reading, ENCODER_COUNTS);
    if (crc8(frame, 3) != frame[3]) {
        return reject(encoder, &encoder->corrupt);
    }
    if ((frame[2] & ERROR_FREE) == 0) {
        return reject(encoder, &encoder->invalid);
    }
    if (is_jump(encoder, move)) {
        return reject(encoder, &encoder->jumps);
    }
    encoder->count += encoder->is_primed ? move : (int32_t)reading;
    move = encoder->is_primed ? move : 0;
    encoder->reading = reading;
    encoder->is_primed = true;
    encoder->bad_ticks = 0;
    encoder->good_ticks++;
    return move;
}

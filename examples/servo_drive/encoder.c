/* SPDX-License-Identifier: MIT */
#include "encoder.h"

#include <dahl.h>

enum { POLYNOMIAL = 0x97, ERROR_FREE = 0x02 /* in byte 2; a warning is no error */ };

static uint8_t crc8(const uint8_t *bytes, uint32_t length)
{
    uint32_t crc = 0;
    for (uint32_t k = 0; k < 8 * length; k++) {
        crc ^= k % 8 == 0 ? bytes[k / 8] : 0u;
        crc = crc << 1 ^ ((crc & 0x80u) != 0 ? 0x100u | POLYNOMIAL : 0u);
    }
    return (uint8_t)~crc;
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
    int32_t move = dahl_counts_between((uint32_t)encoder->count % ENCODER_COUNTS, reading, ENCODER_COUNTS);
    int64_t most = (int64_t)ENCODER_MAX_STEP * (encoder->bad_ticks + 1); /* it may have moved on in bad ticks */
    bool is_first = !encoder->is_primed;
    if (crc8(frame, 3) != frame[3]) {
        return reject(encoder, &encoder->corrupt);
    }
    if ((frame[2] & ERROR_FREE) == 0) {
        return reject(encoder, &encoder->invalid);
    }
    if (!is_first && (move > most || move < -most)) {
        return reject(encoder, &encoder->jumps);
    }
    encoder->count = (int32_t)((uint32_t)encoder->count + (uint32_t)move);
    encoder->is_primed = true;
    encoder->bad_ticks = 0;
    encoder->good_ticks++;
    return is_first ? 0 : move;
}

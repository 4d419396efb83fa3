/* SPDX-License-Identifier: MIT */
/* encoder: see encoder.h. */
#include "encoder.h"

#include "frames.h"

static uint16_t bit(uint8_t counter)
{
    return (uint16_t)(1u << counter);
}

bool encoder_tick(encoder_t *encoder, uint64_t now_ns, can_frame_t *out)
{
    encoder_state_t state = {.counter = encoder->counter, .valid = true};
    int result = motion_next(encoder->motion, &state.count);
    if (result != 1) {
        encoder->ended = true;
        encoder->failed = result < 0;
        return false;
    }
    encoder->open |= bit(state.counter);
    encoder->sent_ns[state.counter] = now_ns;
    encoder->sent++;
    encoder->counter = (encoder->counter + 1) & 0x0F;
    frames_pack_encoder(out, encoder->node, &state);
    return true;
}

static void match(encoder_t *encoder, uint8_t echo, uint64_t now_ns)
{
    if ((encoder->open & bit(echo)) == 0) {
        encoder->unmatched++;
        return;
    }
    encoder->open = (uint16_t)(encoder->open & ~bit(echo));
    encoder->answered++;
    histogram_add(&encoder->latency, now_ns - encoder->sent_ns[echo]);
}

void encoder_receive(encoder_t *encoder, const can_frame_t *in, uint64_t now_ns)
{
    friction_torque_t torque;
    if (in->id != (FRAMES_ID_TORQUE | encoder->node)) {
        return;
    }
    if (frames_unpack_torque(in, &torque) != FRAMES_GOOD) {
        encoder->corrupt++;
        return;
    }
    match(encoder, torque.echo, now_ns);
}

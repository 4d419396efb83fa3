/* SPDX-License-Identifier: MIT */
#include "encoder_node.h"

#include "dahl_frames.h"
#include "timing.h"

enum { COUNTERS = 16 }; /* values of the 4-bit counter */

static uint8_t counter_of(uint64_t sequence)
{
    return (uint8_t)(sequence % COUNTERS);
}

bool encoder_tick(encoder_t *encoder, uint64_t now_ns, dahl_can_frame_t *out)
{
    dahl_encoder_state_t state = {.counter = counter_of(encoder->sent), .valid = true};
    int result = motion_next(encoder->motion, &state.count);
    if (result != 1) {
        encoder->has_ended = true;
        encoder->has_failed = result < 0;
        return false;
    }
    encoder->sent_ns[encoder->sent % ENCODER_WAITING] = now_ns;
    encoder->sent++;
    if (encoder->sent - encoder->next > ENCODER_WAITING) {
        encoder->next++;
    }
    dahl_frames_pack_encoder(out, encoder->node, &state);
    return true;
}

bool encoder_load(encoder_t *encoder, dahl_can_frame_t *out)
{
    if (encoder->load == NULL) {
        return false;
    }
    dahl_param_write_t request = {.param = DAHL_FRAMES_PARAM_LOAD, .write = DAHL_FRAMES_PARAM_WRITE};
    request.value = encoder_load_of(encoder->load, encoder->motion->load, 1);
    if (request.value == encoder->load_sent && encoder->sent % ENCODER_LOAD_TICKS != 0) {
        return false;
    }
    request.counter = counter_of(encoder->loads++);
    encoder->load_sent = request.value;
    dahl_frames_pack_param_write(out, encoder->node, &request);
    return true;
}

static bool is_restart(uint8_t state)
{
    return state == DAHL_FRAMES_INIT || state == DAHL_FRAMES_STALE || state == DAHL_FRAMES_WRONG_SEQUENCE;
}

/* Frames from sequence number `from` to the next one with this counter: 0 to 15. */
static uint64_t frames_until(uint64_t from, uint8_t counter)
{
    return (counter - from) % COUNTERS;
}

static void measure(encoder_t *encoder, uint64_t latency_ns)
{
    uint64_t change = latency_ns > encoder->last_ns ? latency_ns - encoder->last_ns : encoder->last_ns - latency_ns;
    if (encoder->answered > 0) {
        histogram_add(&encoder->jitter, change);
    }
    histogram_add(&encoder->latency, latency_ns);
    encoder->late += latency_ns > PERIOD_NS ? 1u : 0u;
    encoder->last_ns = latency_ns;
}

static void match(encoder_t *encoder, const dahl_friction_torque_t *torque, uint64_t now_ns)
{
    uint64_t found = encoder->next + frames_until(encoder->next, torque->echo);
    if (is_restart(torque->state) && encoder->sent > encoder->next + COUNTERS) {
        found = encoder->sent - COUNTERS + frames_until(encoder->sent, torque->echo);
    }
    if (found >= encoder->sent) {
        encoder->unmatched++;
        return;
    }
    encoder->next = found + 1;
    measure(encoder, now_ns - encoder->sent_ns[found % ENCODER_WAITING]);
    encoder->answered++;
    encoder->torque_q30 = torque->torque_q30;
    encoder->torque_of = found + 1;
}

void encoder_receive(encoder_t *encoder, const dahl_can_frame_t *in, uint64_t now_ns)
{
    dahl_friction_torque_t torque;
    if (in->id != (DAHL_FRAMES_ID_TORQUE | encoder->node)) {
        return;
    }
    if (dahl_frames_unpack_torque(in, &torque) != DAHL_FRAMES_GOOD) {
        encoder->corrupt++;
        return;
    }
    match(encoder, &torque, now_ns);
}

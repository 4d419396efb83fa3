/* SPDX-License-Identifier: MIT */
/**
 * Supervision of the encoder: sequence counter, timeout, bus-off and jumps decide which counts move the bristle.
 *
 * For an EncoderState, accept_encoder() selects one of four handlers. fault_table.h lists each case and its outcome.
 * @verbatim
 *   no starting point                     handle_start()
 *   same counter as before                handle_repeat()
 *   allowed counter step                  handle_in_sequence()
 *   larger counter step                   handle_out_of_sequence()
 * @endverbatim
 * A handler returns true if it wrote an answer. A node is "primed" if `count` is a valid starting point.
 */
#ifndef DAHL_NODE_SUPERVISION_H
#define DAHL_NODE_SUPERVISION_H

#include "torque_answer.h"

static void enter(dahl_node_t *node, dahl_frames_state_t state)
{
    node->state = (uint8_t)state;
    if (state != DAHL_FRAMES_OK) {
        node->errors = (uint8_t)(node->errors | (1u << state));
    }
}

/** Return true if the frame may be used; otherwise count the error. */
static bool is_good(dahl_node_t *node, dahl_frames_check_t check)
{
    switch (check) {
    case DAHL_FRAMES_GOOD:
        return true;
    case DAHL_FRAMES_BAD_FORMAT:
        node->counts.format++;
        node->errors |= DAHL_FRAMES_ERROR_FORMAT;
        break;
    default:
        node->counts.crc++;
        break;
    }
    enter(node, DAHL_FRAMES_CRC);
    if (!node->primed) {
        node->good_in_a_row = 0;
    }
    return false;
}

/** Return true if the shaft can have moved this far: max_step counts for each of `frames` frames of 1 ms, or for
 * each started ms since the last accepted count if there are more. */
static bool is_plausible(const dahl_node_t *node, const dahl_encoder_state_t *encoder, uint32_t frames, uint32_t now_us)
{
    int32_t dcounts = travel(node, encoder);
    uint32_t size = dcounts < 0 ? 0u - (uint32_t)dcounts : (uint32_t)dcounts;
    uint32_t elapsed_ms = (elapsed_us(node, now_us) + 999u) / 1000u;
    uint64_t most = (uint64_t)node->max_step * (elapsed_ms > frames ? elapsed_ms : frames);
    return size <= most;
}

/** Return true for a valid frame, if at least DAHL_NODE_REARM frames in a row had the next counter. */
static bool confirm_sequence(dahl_node_t *node, const dahl_encoder_state_t *encoder)
{
    if (encoder->counter != ((node->candidate + 1) & 0x0F)) {
        node->good_in_a_row = 0;
    }
    if (node->good_in_a_row < UINT8_MAX) {
        node->good_in_a_row++;
    }
    node->candidate = encoder->counter;
    return node->good_in_a_row >= DAHL_NODE_REARM && encoder->valid;
}

/** If enough frames follow each other, use the count: as a move if MaxStep confirms it, otherwise as a new starting
 * point. */
static bool handle_out_of_sequence(dahl_node_t *node, const dahl_encoder_state_t *encoder, uint32_t now_us,
                                   dahl_can_frame_t *out)
{
    bool is_confirmed = confirm_sequence(node, encoder);
    enter(node, DAHL_FRAMES_WRONG_SEQUENCE);
    if (is_confirmed && node->max_step > 0 && is_plausible(node, encoder, 1, now_us)) {
        enter(node, DAHL_FRAMES_LOST);
        return answer_move(node, encoder, now_us, out);
    }
    node->counts.wrong_sequence++;
    if (!is_confirmed) {
        return false;
    }
    return prime(node, encoder, now_us, out);
}

static bool handle_repeat(dahl_node_t *node)
{
    node->counts.repeated++;
    enter(node, DAHL_FRAMES_REPEATED);
    return false;
}

static bool ignore_invalid(dahl_node_t *node, uint8_t counter)
{
    node->counts.invalid++;
    node->errors |= DAHL_FRAMES_ERROR_INVALID;
    node->counter = counter;
    return false;
}

static bool reject_jump(dahl_node_t *node, const dahl_encoder_state_t *encoder, uint32_t now_us, dahl_can_frame_t *out)
{
    node->counts.jump++;
    node->errors |= DAHL_FRAMES_ERROR_JUMP;
    node->counter = encoder->counter;
    if (!confirm_sequence(node, encoder)) {
        return false;
    }
    enter(node, DAHL_FRAMES_WRONG_SEQUENCE);
    return prime(node, encoder, now_us, out);
}

static bool handle_in_sequence(dahl_node_t *node, const dahl_encoder_state_t *encoder, uint8_t step, uint32_t now_us,
                               dahl_can_frame_t *out)
{
    node->counts.lost += step - 1u;
    enter(node, step == 1 ? DAHL_FRAMES_OK : DAHL_FRAMES_LOST);
    if (!encoder->valid) {
        return ignore_invalid(node, encoder->counter);
    }
    if (node->max_step > 0 && !is_plausible(node, encoder, step, now_us)) {
        return reject_jump(node, encoder, now_us, out);
    }
    return answer_move(node, encoder, now_us, out);
}

/** Return true if the timeout after a bus-off runs, or if DAHL_NODE_OFF_MAX bus-offs have latched the node. */
static bool is_held(const dahl_node_t *node, uint32_t now_us)
{
    return node->bus_off_count >= DAHL_NODE_OFF_MAX
           || (node->bus_off_count > 0 && now_us - node->bus_off_us < node->timeout_us);
}

/** Return true if the silence ends: enough good frames in a row, none of them while is_held(). */
static bool is_back(dahl_node_t *node, const dahl_encoder_state_t *encoder, uint32_t now_us)
{
    if (is_held(node, now_us)) {
        node->good_in_a_row = 0;
        return false;
    }
    return confirm_sequence(node, encoder);
}

static bool handle_start(dahl_node_t *node, const dahl_encoder_state_t *encoder, uint32_t now_us, dahl_can_frame_t *out)
{
    node->state = node->silenced ? DAHL_FRAMES_STALE : DAHL_FRAMES_INIT;
    if (!encoder->valid) {
        node->good_in_a_row = 0;
        return ignore_invalid(node, encoder->counter);
    }
    if (node->silenced && !is_back(node, encoder, now_us)) {
        node->counts.rearm++;
        return false;
    }
    node->counts.ok++;
    return prime(node, encoder, now_us, out);
}

static bool accept_encoder(dahl_node_t *node, const dahl_encoder_state_t *encoder, uint32_t now_us, dahl_can_frame_t *out)
{
    uint8_t step = (uint8_t)(encoder->counter - node->counter) & 0x0F;
    if (!node->primed) {
        return handle_start(node, encoder, now_us, out);
    }
    if (step == 0) {
        return handle_repeat(node);
    }
    if (step > (node->max_step > 0 ? DAHL_NODE_GAP_MAX_STEP : DAHL_NODE_GAP_MAX)) {
        return handle_out_of_sequence(node, encoder, now_us, out);
    }
    return handle_in_sequence(node, encoder, step, now_us, out);
}

static void fall_silent(dahl_node_t *node)
{
    node->primed = false;
    node->good_in_a_row = 0;
    node->gain_now = node->ramp_us == 0 ? node->gain_now : 0;
    node->gain_rest = 0;
    node->silenced = true;
    node->urgent = true;
    enter(node, DAHL_FRAMES_STALE);
}

static void check_age(dahl_node_t *node, uint32_t now_us)
{
    if (node->primed && elapsed_us(node, now_us) > node->timeout_us) {
        node->counts.stale++;
        fall_silent(node);
    }
}

static inline bool on_encoder(dahl_node_t *node, const dahl_can_frame_t *in, uint32_t now_us, dahl_can_frame_t *out)
{
    dahl_encoder_state_t encoder;
    if (!is_good(node, dahl_frames_unpack_encoder(in, &encoder))) {
        return false;
    }
    check_age(node, now_us);
    return accept_encoder(node, &encoder, now_us, out);
}

#endif

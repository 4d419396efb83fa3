/* SPDX-License-Identifier: MIT */
/* node: see node.h. One function per row of its table; node_receive only decides which. */
#include "node.h"

void node_init(node_t *node, const dahl_plan_t *plan, uint8_t number)
{
    *node = (node_t){
        .plan = plan,
        .timeout_us = NODE_TIMEOUT_US,
        .status_us = NODE_STATUS_US,
        .number = number & 0x0F,
        .state = FRAMES_INIT,
        .start = FRAMES_INIT,
    };
}

static void enter(node_t *node, frames_state_t state)
{
    node->state = (uint8_t)state;
    if (state != FRAMES_OK && state != FRAMES_INIT) {
        node->errors = (uint8_t)(node->errors | (1u << state));
    }
}

static bool answer(node_t *node, const encoder_state_t *seen, uint32_t now_us, int32_t torque_q30, can_frame_t *out)
{
    node->count = (uint32_t)seen->count;
    node->counter = seen->counter;
    node->good_us = now_us;
    node->primed = true;
    node->doubtful = false;
    friction_torque_t torque = {
        .torque_q30 = torque_q30,
        .counter = node->torque_counter,
        .state = node->state,
        .echo = seen->counter,
    };
    node->torque_counter = (node->torque_counter + 1) & 0x0F;
    frames_pack_torque(out, node->number, &torque);
    return true;
}

/* The count is a starting point: a move of 0 counts only reads the torque. */
static bool prime(node_t *node, const encoder_state_t *seen, uint32_t now_us, can_frame_t *out)
{
    return answer(node, seen, now_us, dahl_step_counts_q30(node->plan, &node->bearing, 0), out);
}

static bool move(node_t *node, const encoder_state_t *seen, uint32_t now_us, can_frame_t *out)
{
    int32_t travel = dahl_counts_between(node->count, (uint32_t)seen->count, 0);
    return answer(node, seen, now_us, dahl_step_counts_q30(node->plan, &node->bearing, travel), out);
}

static bool out_of_sequence(node_t *node, const encoder_state_t *seen, uint32_t now_us, can_frame_t *out)
{
    bool confirmed = node->doubtful && seen->counter == ((node->candidate + 1) & 0x0F);
    node->counts.wrong_sequence++;
    enter(node, FRAMES_WRONG_SEQUENCE);
    node->candidate = seen->counter;
    node->doubtful = true;
    return confirmed && seen->valid && prime(node, seen, now_us, out);
}

static bool repeated(node_t *node)
{
    node->counts.repeated++;
    enter(node, FRAMES_REPEATED);
    return false;
}

static bool invalid(node_t *node, uint8_t counter)
{
    node->counts.invalid++;
    node->errors |= FRAMES_ERROR_INVALID;
    node->counter = counter;
    return false;
}

static bool in_sequence(node_t *node, const encoder_state_t *seen, uint8_t step, uint32_t now_us, can_frame_t *out)
{
    node->counts.lost += step - 1u;
    enter(node, step == 1 ? FRAMES_OK : FRAMES_LOST);
    if (!seen->valid) {
        return invalid(node, seen->counter);
    }
    node->counts.ok++;
    return move(node, seen, now_us, out);
}

static bool first(node_t *node, const encoder_state_t *seen, uint32_t now_us, can_frame_t *out)
{
    if (!seen->valid) {
        return invalid(node, seen->counter);
    }
    node->counts.ok++;
    node->state = node->start;
    return prime(node, seen, now_us, out);
}

static bool accept(node_t *node, const encoder_state_t *seen, uint32_t now_us, can_frame_t *out)
{
    uint8_t step = (uint8_t)(seen->counter - node->counter) & 0x0F;
    if (!node->primed) {
        return first(node, seen, now_us, out);
    }
    if (step == 0) {
        return repeated(node);
    }
    if (step > NODE_GAP_MAX) {
        return out_of_sequence(node, seen, now_us, out);
    }
    return in_sequence(node, seen, step, now_us, out);
}

static bool reject(node_t *node, frames_check_t why)
{
    enter(node, FRAMES_CRC);
    if (why == FRAMES_BAD_FORMAT) {
        node->counts.format++;
        node->errors |= FRAMES_ERROR_FORMAT;
    } else {
        node->counts.crc++;
    }
    return false;
}

static void check_age(node_t *node, uint32_t now_us)
{
    int32_t age = (int32_t)(now_us - node->good_us); /* below 0 where the clock went back: not old */
    if (node->primed && age > 0 && (uint32_t)age > node->timeout_us) {
        node->counts.stale++;
        node->primed = false;
        node->start = FRAMES_STALE;
        enter(node, FRAMES_STALE);
    }
}

bool node_receive(node_t *node, const can_frame_t *in, uint32_t now_us, can_frame_t *out)
{
    encoder_state_t seen;
    if (in->id != (FRAMES_ID_ENCODER | node->number)) {
        node->counts.ignored++;
        return false;
    }
    frames_check_t result = frames_unpack_encoder(in, &seen);
    if (result != FRAMES_GOOD) {
        return reject(node, result);
    }
    check_age(node, now_us);
    return accept(node, &seen, now_us, out);
}

static uint8_t low_byte(uint32_t value)
{
    return (uint8_t)(value & 0xFFu);
}

static void pack_status(node_t *node, can_frame_t *out)
{
    const node_counts_t *n = &node->counts;
    node_status_t status = {
        .counter = node->status_counter,
        .state = node->state,
        .errors = node->errors,
        .lost = low_byte(n->lost),
        .corrupt = low_byte(n->crc + n->format),
        .out_of_step = low_byte(n->repeated + n->wrong_sequence + n->stale),
        .version_major = DAHL_VERSION_MAJOR,
        .version_minor = DAHL_VERSION_MINOR,
    };
    node->status_counter = (node->status_counter + 1) & 0x0F;
    frames_pack_status(out, node->number, &status);
}

bool node_tick(node_t *node, uint32_t now_us, can_frame_t *out)
{
    check_age(node, now_us);
    if (node->status_us == 0 || (node->greeted && now_us - node->sent_us < node->status_us)) {
        return false;
    }
    node->greeted = true;
    node->sent_us = now_us;
    pack_status(node, out);
    return true;
}

/* SPDX-License-Identifier: MIT */
/** Friction node: start, reception of frames, Reset and Status. dahl_node_receive() selects a handler by frame id.
 * The headers are parts of this file, so that the compiler may inline them. */
#include "parameters.h"
#include "supervision.h"
#include "torque_answer.h"

static uint8_t low_byte(uint32_t value)
{
    return (uint8_t)(value & 0xFFu);
}

static dahl_node_tally_t tally(const dahl_node_counts_t *n)
{
    return (dahl_node_tally_t){
        .lost = low_byte(n->lost),
        .corrupt = low_byte(n->crc + n->format),
        .out_of_step = low_byte(n->repeated + n->wrong_sequence + n->jump + n->stale + n->bus_off),
    };
}

static void clear_errors(dahl_node_t *node)
{
    node->errors = 0;
    node->cleared = tally(&node->counts);
}

/** Return to power-on, but keep the parameters. */
static void restart(dahl_node_t *node)
{
    node->bearing = (dahl_state_t){0};
    if (node->model != NULL) {
        dahl_node_relax(node->model);
    }
    node->held = node->params;
    node->state = DAHL_FRAMES_INIT;
    node->silenced = false;
    node->gain_now = node->ramp_us == 0 ? gain_to_reach(node) : 0;
    node->gain_rest = 0;
    node->bus_off_count = 0;
    node->torque_counter = 0;
    node->status_counter = 0;
    node->primed = false;
    node->urgent = true;
    clear_errors(node);
}

dahl_err_t dahl_node_init(dahl_node_t *node, const dahl_params_t *params, uint8_t number)
{
    dahl_plan_t plan;
    dahl_err_t err = dahl_prepare(&plan, params);
    if (err == DAHL_OK) {
        *node = (dahl_node_t){
            .plan = plan,
            .params = *params,
            .gain = DAHL_NODE_ONE,
            .limit = DAHL_NODE_ONE,
            .load = DAHL_NODE_ONE,
            .timeout_us = DAHL_NODE_TIMEOUT_US,
            .status_us = DAHL_NODE_STATUS_US,
            .number = number & 0x0F,
        };
        restart(node);
    }
    return err;
}

static uint8_t status_timeout(const dahl_node_t *node)
{
    uint32_t whole = node->timeout_us / DAHL_FRAMES_TIMEOUT_US, rest = node->timeout_us % DAHL_FRAMES_TIMEOUT_US;
    uint32_t rounded_up = whole + (rest != 0 ? 1u : 0u);
    return (uint8_t)dahl_least(rounded_up, UINT8_MAX);
}

static void pack_status(dahl_node_t *node, uint32_t now_us, dahl_can_frame_t *out)
{
    dahl_node_tally_t sum = tally(&node->counts);
    dahl_node_status_t status = {
        .counter = node->status_counter,
        .state = node->state,
        .errors = node->errors,
        .lost = low_byte((uint32_t)sum.lost - node->cleared.lost),
        .corrupt = low_byte((uint32_t)sum.corrupt - node->cleared.corrupt),
        .out_of_step = low_byte((uint32_t)sum.out_of_step - node->cleared.out_of_step),
        .version_major = DAHL_VERSION_MAJOR,
        .version_minor = DAHL_VERSION_MINOR,
        .timeout = status_timeout(node),
    };
    node->status_counter = (node->status_counter + 1) & 0x0F;
    node->sent_us = now_us;
    node->urgent = false;
    dahl_frames_pack_status(out, node->number, &status);
}

static bool on_reset(dahl_node_t *node, const dahl_can_frame_t *in, uint32_t now_us, dahl_can_frame_t *out)
{
    dahl_node_reset_t request;
    if (!is_good(node, dahl_frames_unpack_reset(in, &request))) {
        return false;
    }
    node->counts.resets++;
    if (request.what == DAHL_FRAMES_RESET_ERRORS) {
        clear_errors(node);
    } else if (request.what == DAHL_FRAMES_RESET_RESTART) {
        restart(node);
    }
    pack_status(node, now_us, out);
    return true;
}

bool dahl_node_receive(dahl_node_t *node, const dahl_can_frame_t *in, uint32_t now_us, dahl_can_frame_t *out)
{
    if (dahl_can_is_bus_off(in)) {
        dahl_node_bus_off(node, now_us);
        return false;
    }
    if ((in->flags & DAHL_CAN_FRAME_ERROR) != 0) {
        node->counts.ignored++;
        return false;
    }
    switch (in->id ^ node->number) {
    case DAHL_FRAMES_ID_ENCODER:
        return on_encoder(node, in, now_us, out);
    case DAHL_FRAMES_ID_PARAM_WRITE:
        return on_param(node, in, out);
    case DAHL_FRAMES_ID_RESET:
        return on_reset(node, in, now_us, out);
    default:
        node->counts.ignored++;
        return false;
    }
}

void dahl_node_bus_off(dahl_node_t *node, uint32_t now_us)
{
    node->counts.bus_off++;
    if (node->bus_off_count < UINT8_MAX) {
        node->bus_off_count++;
    }
    node->bus_off_us = now_us;
    fall_silent(node);
}

/** Keep the age of a bus-off below 2^31 us, so that it does not wrap. */
static void check_bus_off_age(dahl_node_t *node, uint32_t now_us)
{
    if (now_us - node->bus_off_us > INT32_MAX) {
        node->bus_off_us = now_us - INT32_MAX;
    }
}

bool dahl_node_tick(dahl_node_t *node, uint32_t now_us, dahl_can_frame_t *out)
{
    check_age(node, now_us);
    check_bus_off_age(node, now_us);
    bool is_due = node->status_us > 0 && now_us - node->sent_us >= node->status_us;
    if (!node->urgent && !is_due) {
        return false;
    }
    pack_status(node, now_us, out);
    return true;
}

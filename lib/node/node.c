/* SPDX-License-Identifier: MIT */
/**
 * Friction node: frames in, frames out. The interface is dahl_node.h.
 *
 * dahl_node_receive() selects a handler by frame id. For an EncoderState, accept_encoder() selects one of four
 * handlers. fault_table.h lists each case and its outcome.
 * @verbatim
 *   no starting point                     handle_start()
 *   same counter as before                handle_repeat()
 *   allowed counter step                  handle_in_sequence()
 *   larger counter step                   handle_out_of_sequence()
 * @endverbatim
 * A handler returns true if it wrote an answer. A node is "primed" if `count` is a valid starting point.
 */
#include "../arith/scale.h"
#include "model_storage.h"

#include <stddef.h>

static const float SIGMA0_STEP = 0x1p-10f;
static const float FC_STEP = 0x1p-20f;
static const float THETA_STEP = 0x1p-38f;

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

static uint32_t gain_to_reach(const dahl_node_t *node)
{
    return dahl_least(node->gain, DAHL_NODE_ONE);
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

static void enter(dahl_node_t *node, dahl_frames_state_t state)
{
    node->state = (uint8_t)state;
    if (state != DAHL_FRAMES_OK) {
        node->errors = (uint8_t)(node->errors | (1u << state));
    }
}

/** Time [us] since the last accepted count; 0 if the clock went back. */
static uint32_t elapsed_us(const dahl_node_t *node, uint32_t now_us)
{
    uint32_t elapsed = now_us - node->good_us;
    return elapsed <= INT32_MAX ? elapsed : 0;
}

/** Return the step of the gain in `elapsed` us. Answers have no fixed period, so it cannot be prepared as the fades of
 * the compensator are. Without the remainder in gain_rest, frequent calls would slow down a long ramp. */
static uint32_t ramp_step(dahl_node_t *node, uint32_t elapsed)
{
    uint32_t whole = DAHL_NODE_ONE * dahl_least(elapsed, DAHL_NODE_ONE - 1);
    uint32_t step = whole / node->ramp_us, rest = whole % node->ramp_us;
    uint32_t to_next_step = node->ramp_us - rest;
    if (node->gain_rest < to_next_step) {
        node->gain_rest += rest;
        return step;
    }
    node->gain_rest = dahl_least(node->gain_rest - to_next_step, node->ramp_us - 1); /* in case the ramp was shortened */
    return step + 1;
}

/** Ramp gain_now towards gain. Called once for each answer. */
static void ramp(dahl_node_t *node, uint32_t elapsed)
{
    uint32_t step = node->ramp_us > 0 ? ramp_step(node, elapsed) : DAHL_NODE_ONE;
    node->gain_now = (uint32_t)dahl_approach((int32_t)node->gain_now, (int32_t)gain_to_reach(node), step);
}

/** Scale the magnitude, so that the opposite torque has the opposite answer. */
static int32_t output(const dahl_node_t *node, int32_t torque_q30)
{
    int32_t part = dahl_scale_q16((int32_t)dahl_magnitude(torque_q30), node->gain_now);
    return dahl_limit(torque_q30 < 0 ? -part : part, (int32_t)(dahl_least(node->limit, DAHL_NODE_ONE) << 14));
}

static bool answer_encoder(dahl_node_t *node, const dahl_encoder_state_t *encoder, uint32_t now_us, int32_t torque_q30,
                           dahl_can_frame_t *out)
{
    ramp(node, node->primed ? elapsed_us(node, now_us) : 0);
    node->count = (uint32_t)encoder->count;
    node->counter = encoder->counter;
    node->good_us = now_us;
    node->primed = true;
    node->good_in_a_row = 0;
    node->bus_off_count = 0;
    dahl_friction_torque_t torque = {
        .torque_q30 = output(node, torque_q30),
        .counter = node->torque_counter,
        .state = node->state,
        .echo = encoder->counter,
    };
    node->torque_counter = (node->torque_counter + 1) & 0x0F;
    dahl_frames_pack_torque(out, node->number, &torque);
    return true;
}

static int32_t step_model(dahl_node_t *node, int32_t dcounts)
{
    if (node->model == NULL) {
        return dahl_step_counts_q30(&node->plan, &node->bearing, dcounts);
    }
    return node->model->calls->step_q30(dahl_node_plan(node->model), dahl_node_state(node->model), dcounts,
                                    dahl_least(node->load, DAHL_NODE_ONE) << 14);
}

static bool prime(dahl_node_t *node, const dahl_encoder_state_t *encoder, uint32_t now_us, dahl_can_frame_t *out)
{
    return answer_encoder(node, encoder, now_us, step_model(node, 0), out);
}

static int32_t travel(const dahl_node_t *node, const dahl_encoder_state_t *encoder)
{
    return dahl_counts_between(node->count, (uint32_t)encoder->count, 0);
}

static bool answer_move(dahl_node_t *node, const dahl_encoder_state_t *encoder, uint32_t now_us, dahl_can_frame_t *out)
{
    node->counts.ok++;
    return answer_encoder(node, encoder, now_us, step_model(node, travel(node, encoder)), out);
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

void dahl_node_bus_off(dahl_node_t *node, uint32_t now_us)
{
    node->counts.bus_off++;
    if (node->bus_off_count < UINT8_MAX) {
        node->bus_off_count++;
    }
    node->bus_off_us = now_us;
    fall_silent(node);
}

static void check_bus_off_age(dahl_node_t *node, uint32_t now_us)
{
    if (now_us - node->bus_off_us > INT32_MAX) {
        node->bus_off_us = now_us - INT32_MAX;
    }
}

static void check_age(dahl_node_t *node, uint32_t now_us)
{
    if (node->primed && elapsed_us(node, now_us) > node->timeout_us) {
        node->counts.stale++;
        fall_silent(node);
    }
}

static bool on_encoder(dahl_node_t *node, const dahl_can_frame_t *in, uint32_t now_us, dahl_can_frame_t *out)
{
    dahl_encoder_state_t encoder;
    if (!is_good(node, dahl_frames_unpack_encoder(in, &encoder))) {
        return false;
    }
    check_age(node, now_us);
    return accept_encoder(node, &encoder, now_us, out);
}

/* --- parameters --------------------------------------------------------------------------------------------------- */

/** A parameter that is a member of dahl_node_t: member = raw * scale, low <= raw <= high. */
typedef struct {
    size_t offset;
    uint32_t low, high, scale;
} setting_t;

static const setting_t settings[] = {
    [DAHL_FRAMES_PARAM_GAIN] = {offsetof(dahl_node_t, gain), 0, DAHL_NODE_ONE, 1},
    [DAHL_FRAMES_PARAM_LIMIT] = {offsetof(dahl_node_t, limit), 0, DAHL_NODE_ONE, 1},
    [DAHL_FRAMES_PARAM_RAMP] = {offsetof(dahl_node_t, ramp_us), 0, 60000, 1000},
    [DAHL_FRAMES_PARAM_TIMEOUT] = {offsetof(dahl_node_t, timeout_us), 1, 60000, 1000},
    [DAHL_FRAMES_PARAM_STEP] = {offsetof(dahl_node_t, max_step), 0, INT32_MAX, 1},
    [DAHL_FRAMES_PARAM_STATUS] = {offsetof(dahl_node_t, status_us), 0, 60000, 1000},
    [DAHL_FRAMES_PARAM_LOAD] = {offsetof(dahl_node_t, load), 0, DAHL_NODE_ONE, 1},
};

static uint32_t *setting_value(dahl_node_t *node, uint8_t param)
{
    return (uint32_t *)(void *)((char *)node + settings[param].offset);
}

static float *model_param(dahl_params_t *params, uint8_t param, float *unit)
{
    switch (param) {
    case DAHL_FRAMES_PARAM_SIGMA0:
        *unit = SIGMA0_STEP;
        return &params->sigma0;
    case DAHL_FRAMES_PARAM_FC:
        *unit = FC_STEP;
        return &params->Fc;
    default:
        *unit = THETA_STEP;
        return &params->theta_per_count;
    }
}

static uint8_t drop_held(dahl_node_t *node)
{
    node->held = node->params;
    return DAHL_FRAMES_PARAM_OUT_OF_RANGE;
}

/** Apply all held values together. */
static uint8_t apply_held(dahl_node_t *node)
{
    dahl_plan_t plan;
    if (dahl_prepare(&plan, &node->held) != DAHL_OK) {
        return drop_held(node);
    }
    dahl_change_plan(&node->plan, &plan, &node->bearing);
    node->params = node->held;
    node->plan = plan;
    return DAHL_FRAMES_PARAM_DONE;
}

static uint8_t write_model(dahl_node_t *node, const dahl_param_write_t *request)
{
    float unit;
    if (request->value == 0 || request->write > DAHL_FRAMES_PARAM_HOLD || node->model != NULL) {
        return drop_held(node);
    }
    float *value = model_param(&node->held, request->param, &unit);
    *value = (float)request->value * unit;
    return request->write == DAHL_FRAMES_PARAM_HOLD ? DAHL_FRAMES_PARAM_DONE : apply_held(node);
}

static bool follows_load(const dahl_node_t *node)
{
    return node->model != NULL && node->model->kind == DAHL_FRAMES_MODEL_LOADED;
}

static uint8_t write_setting(dahl_node_t *node, const dahl_param_write_t *request)
{
    const setting_t *setting = &settings[request->param];
    if (request->param == DAHL_FRAMES_PARAM_LOAD && !follows_load(node)) {
        return DAHL_FRAMES_PARAM_OUT_OF_RANGE;
    }
    if (request->write != DAHL_FRAMES_PARAM_WRITE || request->value < setting->low || request->value > setting->high) {
        return DAHL_FRAMES_PARAM_OUT_OF_RANGE;
    }
    *setting_value(node, request->param) = request->value * setting->scale;
    return DAHL_FRAMES_PARAM_DONE;
}

static uint8_t write_param(dahl_node_t *node, const dahl_param_write_t *request)
{
    if (request->param > DAHL_FRAMES_PARAM_LOAD) {
        return DAHL_FRAMES_PARAM_UNKNOWN;
    }
    if (request->write == DAHL_FRAMES_PARAM_READ) {
        return DAHL_FRAMES_PARAM_DONE;
    }
    if (request->param == DAHL_FRAMES_PARAM_MODEL) {
        return DAHL_FRAMES_PARAM_OUT_OF_RANGE;
    }
    return request->param <= DAHL_FRAMES_PARAM_THETA ? write_model(node, request) : write_setting(node, request);
}

static uint32_t read_param(dahl_node_t *node, uint8_t param)
{
    float unit;
    if (param == DAHL_FRAMES_PARAM_MODEL) {
        return node->model == NULL ? DAHL_FRAMES_MODEL_DAHL : node->model->kind;
    }
    if (param > DAHL_FRAMES_PARAM_THETA) {
        uint32_t value = *setting_value(node, param), scale = settings[param].scale;
        return value / scale + (value % scale >= scale - value % scale ? 1u : 0u);
    }
    float raw = *model_param(&node->params, param, &unit);
    raw /= unit;
    if (raw >= 0x1p32f) {
        return UINT32_MAX;
    }
    uint32_t whole = (uint32_t)raw;
    return whole + (raw - (float)whole >= 0.5f ? 1u : 0u);
}

static bool on_param(dahl_node_t *node, const dahl_can_frame_t *in, dahl_can_frame_t *out)
{
    dahl_param_write_t request;
    if (!is_good(node, dahl_frames_unpack_param_write(in, &request))) {
        return false;
    }
    dahl_param_reply_t reply = {.counter = request.counter, .param = request.param, .result = write_param(node, &request)};
    node->counts.params++;
    if (reply.result == DAHL_FRAMES_PARAM_UNKNOWN) {
        reply.param = DAHL_FRAMES_PARAM_NONE;
        reply.value = request.param;
    } else {
        reply.value = read_param(node, request.param);
    }
    dahl_frames_pack_param_reply(out, node->number, &reply);
    return true;
}

/* --- status and reset --------------------------------------------------------------------------------------------- */

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

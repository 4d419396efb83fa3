/* SPDX-License-Identifier: MIT */
#include "can.h"

#include <dahl_frames.h>

#include "drive.h"

enum { NODE = 0, ID_COMMAND = 0x160, ID_DRIVE = 0x170, KIND_COMMAND = 0xF, KIND_DRIVE = 0x0 };
enum { MOTION_TICKS = 10, STATUS_TICKS = 100 };
enum { STOP = 0, MOVE = 1, COMMISSION = 2, SAVE = 3, CLEAR = 4 }; /* Command */
#define GAIN_UNIT (1.0f / 65536)
#define FC_UNIT (1.0f / 1048576)
#define SIGMA0_UNIT (1.0f / 1024)
#define THETA_UNIT (1.0f / 274877906944.0f)

static store_params_t params;
static store_result_t stored;
static bool is_saved; /* params are those in flash */
static drive_report_t now;
static struct { uint32_t corrupt, jumps, invalid; } cleared; /* at the last CLEAR; Status shows the difference */
static uint8_t format_error, last_state, last_fault, counters[4]; /* of EncoderState, FrictionTorque, Status, DriveStatus */
static uint32_t sent_motion, sent_status;

void can_start(const store_params_t *from, store_result_t result)
{
    params = *from;
    stored = result;
    is_saved = result == STORE_GOOD || result == STORE_TORN;
}

/* --- telemetry ---------------------------------------------------------------------------------- */

static uint8_t input_state(void)
{
    return (uint8_t)(!now.is_primed                                          ? DAHL_FRAMES_INIT
                     : now.state == DRIVE_FAULT && now.fault == DRIVE_ENCODER ? DAHL_FRAMES_STALE
                     : now.is_good                                           ? DAHL_FRAMES_OK
                                                                             : DAHL_FRAMES_CRC);
}

static void send_motion(void)
{
    dahl_can_frame_t frame;
    int32_t ratio = now.ratio_q30 > 1 << 30 ? 1 << 30 : now.ratio_q30 < -(1 << 30) ? -(1 << 30) : now.ratio_q30;
    const dahl_encoder_state_t count = {now.count, counters[0]++ & 0xF, now.is_good};
    const dahl_friction_torque_t friction = {ratio, counters[1]++ & 0xF, input_state(), count.counter};
    dahl_frames_pack_encoder(&frame, NODE, &count);
    board_can_send(&frame);
    dahl_frames_pack_torque(&frame, NODE, &friction);
    board_can_send(&frame);
}

static void send_status(void)
{
    dahl_can_frame_t frame;
    uint32_t corrupt = now.corrupt - cleared.corrupt, jumps = now.jumps - cleared.jumps;
    uint32_t errors = (corrupt > 0 ? 1u << DAHL_FRAMES_CRC : 0u) | (jumps > 0 ? DAHL_FRAMES_ERROR_JUMP : 0u)
                      | (now.invalid != cleared.invalid ? DAHL_FRAMES_ERROR_INVALID : 0u) | format_error
                      | (now.fault == DRIVE_ENCODER ? 1u << DAHL_FRAMES_STALE : 0u);
    const dahl_node_status_t status = {.counter = counters[2]++ & 0xF, .state = input_state(), .errors = (uint8_t)errors,
                                       .corrupt = (uint8_t)corrupt, .out_of_step = (uint8_t)jumps, .timeout = 1,
                                       .version_major = DAHL_VERSION_MAJOR, .version_minor = DAHL_VERSION_MINOR};
    dahl_frames_pack_status(&frame, NODE, &status);
    board_can_send(&frame);
}

static void send_drive(void)
{
    dahl_can_frame_t frame = {.id = ID_DRIVE + NODE, .length = 8};
    int16_t milli = (int16_t)(now.torque * 1000.0f);
    frame.data[1] = (uint8_t)((counters[3]++ & 0xFu) | now.state << 4);
    frame.data[2] = (uint8_t)(now.fault | stored << 4 | is_saved << 6);
    frame.data[3] = now.stage;
    frame.data[4] = (uint8_t)now.refusal;
    frame.data[6] = (uint8_t)milli;
    frame.data[7] = (uint8_t)((uint16_t)milli >> 8);
    frame.data[0] = dahl_frames_crc(frame.data, KIND_DRIVE);
    board_can_send(&frame);
}

static void send_telemetry(void)
{
    bool is_change = now.state != last_state || now.fault != last_fault;
    if (now.ticks - sent_motion >= MOTION_TICKS) {
        sent_motion = now.ticks;
        send_motion();
    }
    if (is_change || now.ticks - sent_status >= STATUS_TICKS) {
        sent_status = now.ticks;
        send_status();
        send_drive();
    }
    last_state = now.state;
    last_fault = now.fault;
}

/* --- parameters --------------------------------------------------------------------------------- */

static bool change(uint8_t param, uint32_t value)
{
    store_params_t next = params;
    if (param == DAHL_FRAMES_PARAM_FC) {
        next.Fc = (float)value * FC_UNIT;
    } else if (param == DAHL_FRAMES_PARAM_GAIN) {
        next.gain = (float)value * GAIN_UNIT;
    } else {
        return false; /* read only */
    }
    if (next.gain > 1 || !drive_set(&next)) {
        return false;
    }
    params = next;
    is_saved = false;
    return true;
}

static uint32_t value_of(uint8_t param)
{
    switch (param) {
    case DAHL_FRAMES_PARAM_FC: return (uint32_t)(params.Fc / FC_UNIT + 0.5f);
    case DAHL_FRAMES_PARAM_GAIN: return (uint32_t)(params.gain / GAIN_UNIT + 0.5f);
    case DAHL_FRAMES_PARAM_SIGMA0: return (uint32_t)(params.sigma0 / SIGMA0_UNIT + 0.5f);
    default: return (uint32_t)(DRIVE_THETA_PER_COUNT / THETA_UNIT);
    }
}

static void on_param(const dahl_can_frame_t *frame)
{
    dahl_can_frame_t out;
    dahl_param_write_t in;
    if (dahl_frames_unpack_param_write(frame, &in) != DAHL_FRAMES_GOOD) {
        format_error = DAHL_FRAMES_ERROR_FORMAT;
        return;
    }
    dahl_param_reply_t reply = {in.param, in.counter, DAHL_FRAMES_PARAM_NONE, DAHL_FRAMES_PARAM_UNKNOWN};
    if (in.param <= DAHL_FRAMES_PARAM_GAIN) {
        bool is_done = in.write == DAHL_FRAMES_PARAM_READ
                       || (in.write == DAHL_FRAMES_PARAM_WRITE && change(in.param, in.value));
        reply.param = in.param;
        reply.value = value_of(in.param);
        reply.result = is_done ? DAHL_FRAMES_PARAM_DONE : DAHL_FRAMES_PARAM_OUT_OF_RANGE;
    }
    dahl_frames_pack_param_reply(&out, NODE, &reply);
    board_can_send(&out);
}

/* --- commands ----------------------------------------------------------------------------------- */

static void save(void)
{
    if (now.state == DRIVE_OFF || now.state == DRIVE_FAULT) { /* an erase stops the ticks on many parts */
        is_saved = store_save(&params);
        stored = is_saved ? STORE_GOOD : STORE_CORRUPT;
    }
}

static void clear_errors(void)
{
    cleared.corrupt = now.corrupt;
    cleared.jumps = now.jumps;
    cleared.invalid = now.invalid;
    format_error = 0;
    drive_order(DRIVE_CLEAR, 0);
}

static void on_command(const dahl_can_frame_t *frame)
{
    const uint8_t *data = frame->data;
    if (frame->length != 8 || (frame->flags & DAHL_CAN_FRAME_FOREIGN) != 0
        || dahl_frames_crc(data, KIND_COMMAND) != data[0]) {
        format_error = DAHL_FRAMES_ERROR_FORMAT;
        return;
    }
    uint32_t target = (uint32_t)data[4] | (uint32_t)data[5] << 8 | (uint32_t)data[6] << 16 | (uint32_t)data[7] << 24;
    switch (data[1] >> 4) {
    case STOP: drive_order(DRIVE_STOP, 0); break;
    case MOVE: drive_order(DRIVE_MOVE, (int32_t)target); break;
    case COMMISSION: drive_order(DRIVE_START_COMMISSION, 0); break;
    case SAVE: save(); break;
    case CLEAR: clear_errors(); break;
    default: format_error = DAHL_FRAMES_ERROR_FORMAT; break;
    }
}

void can_serve(void)
{
    dahl_can_frame_t frame;
    drive_read(&now);
    if (drive_commissioned(&params)) {
        (void)drive_set(&params);
        save();
    }
    while (drive_is_ready() && board_can_receive(&frame)) {
        if (frame.id == DAHL_FRAMES_ID_PARAM_WRITE + NODE) {
            on_param(&frame);
        } else if (frame.id == ID_COMMAND + NODE) {
            on_command(&frame);
        }
    }
    send_telemetry();
}

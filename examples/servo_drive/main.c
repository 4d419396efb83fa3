/* SPDX-License-Identifier: MIT */
/* The main program: start with the stored parameters, serve the bus, check the plans. README.md lists the frames. A frame with
 * a wrong CRC or form is dropped, and Status reports ErrorFormat. */
#include <dahl_frames.h>

#include "drive.h"

enum { NODE = 0, ID_COMMAND = 0x160, ID_DRIVE = 0x170, KIND_COMMAND = 0xF, KIND_DRIVE = 0x0 }; /* of servo_drive.dbc */
enum { NO_COMMAND = 0xFF, MOTION_TICKS = 10, STATUS_TICKS = 100, CHECK_PASSES = 10 };
#define FC_UNIT (1.0f / 1048576) /* N m */
#define GAIN_UNIT (1.0f / 65536)
#define TARGET_MOST 1000000000u /* counts: the difference of two fits into 32 bits */

/* For a first commissioning: only the inertia must be right, within a factor of 1.5. */
static const store_params_t defaults = {
    .Fc = 0.3f, .sigma0 = 60, .gain = 0.9f, .inertia = 0.0024f, .inertia_low = 0.0016f, .delay = 1, .noise = 1};

static store_params_t params;
static store_result_t stored;
static bool is_saved;        /* params are those in flash */
static bool is_save_pending; /* until the torque is 0 */
static drive_report_t now, last;
static uint32_t format_error, sent_motion, sent_status; /* bit of Status, ticks */
static uint8_t motion_counter, status_counter;
static uint8_t last_command = NO_COMMAND; /* its order and counter */

/* --- telemetry ---------------------------------------------------------------------------------- */

static uint8_t input_state(void)
{
    if (now.fault == DRIVE_ENCODER) {
        return DAHL_FRAMES_STALE;
    }
    return !now.encoder.is_primed ? DAHL_FRAMES_INIT : now.encoder.bad_ticks > 0 ? DAHL_FRAMES_CRC : DAHL_FRAMES_OK;
}

static void send_motion(void)
{
    dahl_can_frame_t frame;
    uint8_t counter = motion_counter++ & 0xF;
    const dahl_encoder_state_t count = {now.encoder.count, counter, now.encoder.bad_ticks == 0};
    const dahl_friction_torque_t friction = {now.ratio_q30, counter, input_state(), counter};
    dahl_frames_pack_encoder(&frame, NODE, &count);
    board_can_send(&frame);
    dahl_frames_pack_torque(&frame, NODE, &friction);
    board_can_send(&frame);
}

static void send_status(void)
{
    dahl_can_frame_t frame;
    uint32_t errors = format_error | (now.encoder.corrupt > 0 ? 1u << DAHL_FRAMES_CRC : 0u)
                      | (now.encoder.invalid > 0 ? DAHL_FRAMES_ERROR_INVALID : 0u)
                      | (now.encoder.jumps > 0 ? DAHL_FRAMES_ERROR_JUMP : 0u)
                      | (now.fault == DRIVE_ENCODER ? 1u << DAHL_FRAMES_STALE : 0u);
    const dahl_node_status_t status = {
        status_counter & 0xF, input_state(), (uint8_t)errors, 0, (uint8_t)now.encoder.corrupt, (uint8_t)now.encoder.jumps,
        DAHL_VERSION_MAJOR, DAHL_VERSION_MINOR, 1};
    dahl_frames_pack_status(&frame, NODE, &status);
    board_can_send(&frame);
}

static void send_drive(void)
{
    uint16_t milli = (uint16_t)(int16_t)(now.torque * 1000.0f);
    dahl_can_frame_t frame = {.id = ID_DRIVE + NODE, .length = 8};
    frame.data[1] = (uint8_t)((status_counter & 0xFu) | 16u * now.state);
    frame.data[2] = (uint8_t)(now.fault + 16u * (uint32_t)stored + 64u * is_saved);
    frame.data[3] = now.stage;
    frame.data[4] = (uint8_t)now.refusal;
    frame.data[6] = (uint8_t)milli;
    frame.data[7] = (uint8_t)(milli >> 8);
    frame.data[0] = dahl_frames_crc(frame.data, KIND_DRIVE);
    board_can_send(&frame);
}

static void send_telemetry(void)
{
    if (now.ticks - sent_motion >= MOTION_TICKS) {
        sent_motion = now.ticks;
        send_motion();
    }
    if (now.state != last.state || now.fault != last.fault || now.ticks - sent_status >= STATUS_TICKS) {
        sent_status = now.ticks;
        send_status();
        send_drive();
        status_counter++;
    }
    last = now;
}

/* --- parameters and commands ---------------------------------------------------------------------- */

static float *number_of(store_params_t *from, uint8_t param)
{
    return param == DAHL_FRAMES_PARAM_FC ? &from->Fc : param == DAHL_FRAMES_PARAM_GAIN ? &from->gain : 0;
}

static bool take_param(const dahl_can_frame_t *frame)
{
    dahl_can_frame_t out;
    dahl_param_write_t in;
    if (dahl_frames_unpack_param_write(frame, &in) != DAHL_FRAMES_GOOD) {
        return false;
    }
    dahl_param_reply_t reply = {in.param, in.counter, DAHL_FRAMES_PARAM_NONE, DAHL_FRAMES_PARAM_UNKNOWN};
    store_params_t next = params;
    float *number = number_of(&next, in.param), unit = in.param == DAHL_FRAMES_PARAM_FC ? FC_UNIT : GAIN_UNIT;
    if (number != 0) {
        *number = in.write == DAHL_FRAMES_PARAM_WRITE ? (float)in.value * unit : *number;
        bool is_set = in.write == DAHL_FRAMES_PARAM_WRITE && drive_set(&next);
        params = is_set ? next : params;
        is_saved = is_saved && !is_set;
        reply.param = in.param;
        reply.value = (uint32_t)(*number_of(&params, in.param) / unit + 0.5f);
        reply.result = is_set || in.write == DAHL_FRAMES_PARAM_READ ? DAHL_FRAMES_PARAM_DONE : DAHL_FRAMES_PARAM_OUT_OF_RANGE;
    }
    dahl_frames_pack_param_reply(&out, NODE, &reply);
    board_can_send(&out);
    return true;
}

/* The flash may stop the ticks, so the torque must be 0: after a Stop, it falls for some ticks. In the states Off and Fault it
 * stays 0, if no order is on its way. */
static void save_pending(void)
{
    if (!is_save_pending || !drive_is_ready()) {
        return;
    }
    drive_read(&now);
    is_save_pending = now.state == DRIVE_OFF || now.state == DRIVE_FAULT;
    if (is_save_pending && now.torque == 0.0f) {
        is_saved = store_save(&params);
        stored = is_saved ? STORE_GOOD : STORE_CORRUPT;
        is_save_pending = false;
    }
}

/* Use and save the result of a commissioning. If drive_set() refuses it, IsSaved becomes 0. */
static void take_result(void)
{
    store_params_t next = params;
    if (drive_is_ready() && drive_take_result(&next)) {
        is_saved = false;
        if (drive_set(&next)) {
            params = next;
            is_save_pending = true;
        }
    }
}

static bool take_command(const dahl_can_frame_t *frame)
{
    const uint8_t *data = frame->data;
    uint32_t target = (uint32_t)data[4] | (uint32_t)data[5] << 8 | (uint32_t)data[6] << 16 | (uint32_t)data[7] << 24;
    order_t order = (order_t)(data[1] >> 4);
    if (frame->length != 8 || (frame->flags & DAHL_CAN_FRAME_FOREIGN) != 0 || dahl_frames_crc(data, KIND_COMMAND) != data[0]
        || order > ORDER_CLEAR || (order == ORDER_MOVE && target + TARGET_MOST > 2 * TARGET_MOST)) {
        return false;
    }
    if (data[1] == last_command) {
        return true; /* sent twice, or by a sender that hangs */
    }
    last_command = data[1];
    if (order == ORDER_SAVE) {
        is_save_pending = true;
    } else {
        drive_order(order, (int32_t)target);
    }
    format_error = order == ORDER_CLEAR ? 0 : format_error;
    return true;
}

static void serve_bus(void)
{
    dahl_can_frame_t frame;
    while (drive_is_ready() && board_can_receive(&frame)) {
        bool is_good = frame.id == DAHL_FRAMES_ID_PARAM_WRITE + NODE ? take_param(&frame)
                       : frame.id == ID_COMMAND + NODE               ? take_command(&frame)
                                                                     : true;
        format_error = is_good ? format_error : DAHL_FRAMES_ERROR_FORMAT;
    }
}

/* --- the program -------------------------------------------------------------------------------- */

static void start(void)
{
    params = defaults;
    stored = store_load(&params);
    drive_start(board_reset_cause());
    if (!drive_set(&params)) { /* a good CRC, but the numbers of no drive */
        params = defaults;
        stored = STORE_CORRUPT;
        (void)drive_set(&params);
    }
    is_saved = stored == STORE_GOOD || stored == STORE_TORN;
}

int main(void)
{
    board_start();
    start();
    for (uint32_t passes = 0;; passes++) {
        board_wait();
        if (passes % CHECK_PASSES == 0) {
            drive_check(); /* before new parameters come */
        }
        drive_read(&now);
        take_result();
        serve_bus();
        save_pending();
        send_telemetry();
    }
}

/* SPDX-License-Identifier: MIT */
/*
 * The node receives any frames at any times. Each frame increases one count. Each answer is a good frame within the limit. The
 * bristle moves only with an answer, and as in the library. A timeout ends only after enough good frames.
 */
#include "dahl_frames.h"
#include "fuzz.h"
#include "dahl_node.h"

enum { INPUT_FRAMES_MAX = 24 };

static const uint8_t kinds[6] = {DAHL_FRAMES_KIND_ENCODER,     DAHL_FRAMES_KIND_TORQUE,      DAHL_FRAMES_KIND_STATUS,
                                 DAHL_FRAMES_KIND_PARAM_WRITE, DAHL_FRAMES_KIND_PARAM_REPLY, DAHL_FRAMES_KIND_RESET};

typedef struct {
    dahl_node_t node;
    uint32_t now_us;
    uint32_t in_a_row; /* good valid EncoderStates, each with the next counter */
    uint32_t last_good;
    uint8_t torque_counter, status_counter;
    dahl_node_counts_t cleared; /* counts at the last Reset */
    uint8_t is_good;   /* the frame is an EncoderState for this node with a good CRC */
    uint8_t is_silent; /* no starting point since a timeout or bus-off */
} receiver_t;

static uint64_t sum_of_counts(const dahl_node_counts_t *n)
{
    return (uint64_t)n->ok + n->repeated + n->wrong_sequence + n->crc + n->format + n->invalid + n->jump + n->rearm +
           n->ignored + n->params + n->resets + n->bus_off;
}

/* The first byte chooses the kind, whether the counter is near the last one, and whether the CRC is right. */
static dahl_can_frame_t any_frame(fuzz_bytes_t *bytes, const receiver_t *r)
{
    uint8_t what = fuzz_u8(bytes), step = fuzz_u8(bytes);
    size_t kind = what & 8u ? 0 : (what & 7u) % 6u;
    dahl_can_frame_t frame = {.id = 0x100u + 0x10u * (uint32_t)kind + r->node.number, .length = 8};
    for (size_t i = 1; i < 8; i++) {
        frame.data[i] = fuzz_u8(bytes);
    }
    if (what & 0x10u) { /* a valid count near the last one */
        uint32_t count = r->node.count + (uint32_t)((int32_t)(fuzz_u8(bytes)) - 128);
        frame.data[1] = (uint8_t)(0x10u | ((r->last_good + (step & 15u)) & 0x0Fu));
        for (size_t i = 0; i < 4; i++) {
            frame.data[2 + i] = (uint8_t)(count >> (8 * i));
        }
    }
    if (kind == 3 && what & 0x20u) { /* a parameter and a value in range */
        frame.data[2] %= 10;
        frame.data[6] = 0;
        frame.data[7] = 0;
    }
    if ((what & 0xC0u) != 0) {
        frame.data[0] = dahl_frames_crc(frame.data, kinds[kind]);
    } else if (step & 0x80u) {
        frame.id = step & 0x40u ? frame.id : fuzz_u32(bytes) & 0x1FFFFFFFu;
        frame.flags = fuzz_u8(bytes);
        frame.length = fuzz_u8(bytes) % 9u;
    }
    return frame;
}

static int is_encoder(const receiver_t *r, const dahl_can_frame_t *in)
{
    return in->id == (DAHL_FRAMES_ID_ENCODER | r->node.number) && (in->flags & DAHL_CAN_FRAME_ERROR) == 0;
}

static void note_sequence(receiver_t *r, const dahl_can_frame_t *in)
{
    dahl_encoder_state_t seen;
    r->is_good = 0;
    if (dahl_can_is_bus_off(in)) {
        r->in_a_row = 0;
        return;
    }
    if (is_encoder(r, in)) {
        int good = dahl_frames_unpack_encoder(in, &seen) == DAHL_FRAMES_GOOD;
        r->is_good = (uint8_t)good;
        int next = good && seen.counter == ((r->last_good + 1) & 15u);
        r->in_a_row = good && seen.valid ? (next ? r->in_a_row + 1 : 1) : 0;
        r->last_good = good ? seen.counter : r->last_good;
    }
}

static int32_t clamped(int64_t value, int32_t limit)
{
    return value > limit ? limit : value < -limit ? -limit : (int32_t)value;
}

static void check_torque(receiver_t *r, const dahl_node_t *before, const dahl_can_frame_t *in, const dahl_can_frame_t *out)
{
    dahl_friction_torque_t torque;
    dahl_encoder_state_t seen;
    HOLDS(dahl_frames_unpack_torque(out, &torque) == DAHL_FRAMES_GOOD, "the answer is a good frame");
    HOLDS(is_encoder(r, in) && dahl_frames_unpack_encoder(in, &seen) == DAHL_FRAMES_GOOD && seen.valid, "only a good EncoderState is answered");
    HOLDS(torque.echo == seen.counter && torque.counter == r->torque_counter, "the answer echoes the counter and increases its own");
    int moved = before->primed && (r->node.state == DAHL_FRAMES_OK || r->node.state == DAHL_FRAMES_LOST);
    dahl_state_t bearing = before->bearing;
    int32_t way = moved ? (int32_t)((uint32_t)seen.count - before->count) : 0;
    int64_t q30 = dahl_step_counts_q30(&before->plan, &bearing, way);
    HOLDS(bearing.w == r->node.bearing.w, "the bristle moves as in the library, or keeps its state");
    int32_t limit = (int32_t)(before->limit << 14);
    HOLDS(torque.torque_q30 == clamped(q30 * r->node.gain_now / (int64_t)DAHL_NODE_ONE, limit), "gain and limit hold");
    HOLDS(!r->is_silent || r->in_a_row >= DAHL_NODE_REARM, "a timeout ends after enough good frames in a row");
    HOLDS(r->node.primed && r->node.count == (uint32_t)seen.count, "an answered count is the new starting point");
    HOLDS(way == 0 || r->node.max_step == 0 || r->now_us - before->good_us > 1u << 30 ||
              (uint64_t)llabs(way) <= (uint64_t)r->node.max_step * (16u + (r->now_us - before->good_us) / 1000u),
          "MaxStep bounds a move");
    r->torque_counter = (r->torque_counter + 1) & 15u;
    r->is_silent = 0;
}

static void check_status(receiver_t *r, const dahl_can_frame_t *out)
{
    dahl_node_status_t status;
    const dahl_node_counts_t *n = &r->node.counts;
    HOLDS(out->id == (DAHL_FRAMES_ID_STATUS | r->node.number), "a Status has the number of the node");
    HOLDS(dahl_frames_unpack_status(out, &status) == DAHL_FRAMES_GOOD, "the Status is a good frame");
    const dahl_node_counts_t *c = &r->cleared;
    const uint32_t steps = n->repeated + n->wrong_sequence + n->jump + n->stale + n->bus_off;
    const uint32_t cleared = c->repeated + c->wrong_sequence + c->jump + c->stale + c->bus_off;
    HOLDS(status.out_of_step == ((steps - cleared) & 255u), "a Status sums the counts of frames out of step");
    const uint32_t timeout = (r->node.timeout_us + DAHL_FRAMES_TIMEOUT_US - 1) / DAHL_FRAMES_TIMEOUT_US;
    HOLDS(status.timeout == (timeout < 255u ? timeout : 255u), "a Status rounds the timeout up");
    HOLDS(status.counter == r->status_counter && status.state == r->node.state && status.errors == r->node.errors &&
              status.lost == ((n->lost - c->lost) & 255u) &&
              status.corrupt == ((n->crc + n->format - c->crc - c->format) & 255u),
          "a Status has the state, errors and counts of the node");
    r->status_counter = (r->status_counter + 1) & 15u;
}

static void check_reply(const receiver_t *r, const dahl_can_frame_t *in, const dahl_can_frame_t *out)
{
    dahl_param_reply_t reply;
    dahl_param_write_t asked;
    HOLDS(dahl_frames_unpack_param_reply(out, &reply) == DAHL_FRAMES_GOOD, "the reply is a good frame");
    HOLDS(dahl_frames_unpack_param_write(in, &asked) == DAHL_FRAMES_GOOD && reply.counter == asked.counter,
          "the reply has the counter of the request");
    int known = reply.result != DAHL_FRAMES_PARAM_UNKNOWN;
    HOLDS(known ? reply.param == asked.param : reply.param == DAHL_FRAMES_PARAM_NONE && reply.value == asked.param,
          "the reply has the parameter of the request");
    HOLDS(asked.write != DAHL_FRAMES_PARAM_WRITE || reply.result != DAHL_FRAMES_PARAM_DONE || reply.value == asked.value ||
              (asked.param <= DAHL_FRAMES_PARAM_THETA && asked.value > 1u << 24),
          "a written value is read back");
    HOLDS(reply.result != DAHL_FRAMES_PARAM_UNKNOWN || asked.param > DAHL_FRAMES_PARAM_LOAD, "only unknown parameters are refused as unknown");
    HOLDS(r->node.gain <= DAHL_NODE_ONE && r->node.limit <= DAHL_NODE_ONE && r->node.timeout_us >= 1000, "settings stay in range");
}

static void note_reset(receiver_t *r, uint8_t what)
{
    if (what == DAHL_FRAMES_RESET_ERRORS || what == DAHL_FRAMES_RESET_RESTART) {
        r->cleared = r->node.counts;
    }
    if (what == DAHL_FRAMES_RESET_RESTART) {
        r->torque_counter = 0;
        r->status_counter = 0;
    }
}

static void check_answer(receiver_t *r, const dahl_node_t *before, const dahl_can_frame_t *in, const dahl_can_frame_t *out)
{
    dahl_node_reset_t reset;
    HOLDS(out->length == 8 && out->flags == 0 && (out->id & 15u) == r->node.number, "an answer is a classic frame of this node");
    switch (out->id & 0x7F0u) {
    case DAHL_FRAMES_ID_TORQUE: check_torque(r, before, in, out); break;
    case DAHL_FRAMES_ID_STATUS:
        HOLDS(dahl_frames_unpack_reset(in, &reset) == DAHL_FRAMES_GOOD, "a Status answers a Reset");
        note_reset(r, reset.what);
        check_status(r, out);
        r->is_silent = reset.what == DAHL_FRAMES_RESET_RESTART ? 0 : r->is_silent;
        break;
    default:
        HOLDS((out->id & 0x7F0u) == DAHL_FRAMES_ID_PARAM_REPLY, "an answer is a torque, a Status or a reply");
        check_reply(r, in, out);
    }
}

static void check_quiet(const receiver_t *r, const dahl_node_t *before)
{
    HOLDS(r->node.bearing.w == before->bearing.w && r->node.count == before->count, "without an answer the bristle keeps its state");
}

static void check_node(receiver_t *r, const dahl_node_t *before)
{
    uint64_t now = sum_of_counts(&r->node.counts);
    HOLDS(now == sum_of_counts(&before->counts) + 1, "a frame increases one count");
    HOLDS(r->node.gain_now <= DAHL_NODE_ONE && r->node.counter < 16 && r->node.candidate < 16 && r->node.state <= DAHL_FRAMES_INIT,
          "the state of the node is in range");
    int64_t w = r->node.bearing.w, most = ((int64_t)1 << 62) + ((int64_t)1 << 31);
    HOLDS(w <= most && w >= -most, "the bristle is in range");
    if (before->primed && !r->node.primed) {
        r->is_silent = r->node.silenced;
        HOLDS(r->node.ramp_us == 0 || r->node.gain_now == 0, "after a silence the gain ramps from 0");
    }
    r->is_silent = r->node.primed ? 0 : r->is_silent;
}

static void tick(receiver_t *r)
{
    dahl_can_frame_t out;
    const dahl_node_t before = r->node;
    int due = dahl_node_tick(&r->node, r->now_us, &out);
    check_quiet(r, &before);
    if (due) {
        check_status(r, &out);
    }
    if (before.primed && !r->node.primed) {
        r->is_silent = 1;
        r->in_a_row = 0;
        HOLDS(r->node.ramp_us == 0 || r->node.gain_now == 0, "after a silence the gain ramps from 0");
    }
}

static void hear(receiver_t *r, fuzz_bytes_t *bytes)
{
    dahl_can_frame_t in = any_frame(bytes, r), out;
    const dahl_node_t before = r->node;
    note_sequence(r, &in);
    int32_t age = (int32_t)(r->now_us - before.good_us);
    if (before.primed && r->is_good && age > 0 && (uint32_t)age > before.timeout_us) {
        r->is_silent = 1; /* the first frame after a timeout is the first of the row */
        r->in_a_row = r->in_a_row > 0 ? 1 : 0;
    }
    if (dahl_node_receive(&r->node, &in, r->now_us, &out)) {
        check_answer(r, &before, &in, &out);
    } else {
        check_quiet(r, &before);
    }
    check_node(r, &before);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fuzz_bytes_t bytes = {data, size};
    const dahl_params_t params = {50.0f, 0.5f, 1e-4f};
    receiver_t r = {.now_us = 0xFFFF0000u};
    HOLDS(dahl_node_init(&r.node, &params, 3) == DAHL_OK, "good parameters are accepted");
    for (int i = 0; i < INPUT_FRAMES_MAX && bytes.left > 0; i++) {
        uint8_t pause = fuzz_u8(&bytes);
        r.now_us += pause < 240 ? pause * 16u : pause < 250 ? pause * 1000u : fuzz_u32(&bytes);
        if (pause & 1u) {
            tick(&r);
        }
        hear(&r, &bytes);
    }
    return 0;
}

/* SPDX-License-Identifier: MIT */
/* Each fault has a function that writes the frames to send and updates the expected counts. */
#include "faults.h"

#include "splitmix.h"
#include "timing.h"

enum {
    MISSING_MAX = 6,    /* consecutive frames: a node with max_step accepts a counter step of 7 */
    LATE_MIN = 2,       /* frames */
    LATE_MAX = 7,
    FLIPS_MAX = 3,      /* bits */
    BABBLE_FRAMES = 8,
    OFF_EXTRA = 10,     /* ticks of silence after the timeout */
    BUS_OFF_TICKS = 5,  /* from the start of the silence to the bus-off event */
    ID_UNUSED = 0x700,  /* first of 255 ids that no node uses */
    ID_BABBLE = 0x0F0,  /* first of 16 ids with a higher priority than any node's */
    ID_NUMBER = 0x00F
};

const char *const fault_names[FAULT_KINDS] = {
#define RUN_FAULT(NAME, name) #name,
#include "run_keys.def"
};

typedef struct {
    dahl_can_frame_t *frames;
    size_t count;
} sink_t;

void faults_open(faults_t *faults, const double rates[FAULT_KINDS], uint64_t seed, uint32_t timeout_us)
{
    *faults = (faults_t){
        .rates = rates, .random = seed, .off_ticks = timeout_us / PERIOD_US + OFF_EXTRA, .good_due = 1};
}

static void put(sink_t *sink, const dahl_can_frame_t *frame)
{
    sink->frames[sink->count++] = *frame;
}

/* The node receives a frame in sequence, so it counts the missing frames before it as lost. */
static void count_lost(faults_t *f)
{
    f->expected.lost += f->missing;
    f->missing = 0;
}

static void send_good(faults_t *f, const dahl_can_frame_t *frame, sink_t *sink)
{
    count_lost(f);
    if (f->rearm > 0) {
        f->rearm--;
        f->expected.rearm++;
    } else {
        f->expected.ok++;
    }
    put(sink, frame);
}

static void drop(faults_t *f, const dahl_can_frame_t *frame, fault_t fault, sink_t *sink)
{
    (void)frame;
    (void)fault;
    (void)sink;
    f->missing++;
}

static void hold(faults_t *f, const dahl_can_frame_t *frame, fault_t fault, sink_t *sink)
{
    uint32_t wait = fault == FAULT_REORDER ? 1 : LATE_MIN + splitmix_below(&f->random, LATE_MAX - LATE_MIN + 1);
    (void)sink;
    f->late[f->late_count++] = (fault_late_t){*frame, wait};
    f->missing++;
    f->good_due = 1;
}

static void flip_bits(faults_t *f, dahl_can_frame_t *frame)
{
    uint64_t mask = 0;
    for (uint32_t flips = 1 + splitmix_below(&f->random, FLIPS_MAX); flips > 0; flips--) {
        mask |= UINT64_C(1) << splitmix_below(&f->random, 64);
    }
    for (uint32_t i = 0; i < 8; i++) {
        frame->data[i] ^= (uint8_t)(mask >> (8 * i));
    }
}

static void corrupt(faults_t *f, const dahl_can_frame_t *frame, fault_t fault, sink_t *sink)
{
    dahl_encoder_state_t unused;
    dahl_can_frame_t changed;
    (void)fault;
    do {
        changed = *frame;
        flip_bits(f, &changed);
    } while (dahl_frames_unpack_encoder(&changed, &unused) == DAHL_FRAMES_GOOD);
    f->expected.crc++;
    f->missing++;
    put(sink, &changed);
}

static void change_form(faults_t *f, const dahl_can_frame_t *in, fault_t fault, sink_t *sink)
{
    dahl_can_frame_t frame = *in;
    if (fault == FAULT_ID) {
        frame.id = ID_UNUSED + splitmix_below(&f->random, 0xFF);
        f->expected.ignored++;
    } else {
        frame.length = fault == FAULT_LENGTH ? (uint8_t)splitmix_below(&f->random, 8) : frame.length;
        frame.flags = fault == FAULT_EXTENDED ? DAHL_CAN_FRAME_EXTENDED : frame.flags;
        f->expected.format++;
    }
    f->missing++;
    put(sink, &frame);
}

/* Send a changed frame with a correct CRC. */
static void change_state(faults_t *f, const dahl_can_frame_t *in, fault_t fault, sink_t *sink)
{
    dahl_can_frame_t frame = *in;
    dahl_encoder_state_t state;
    dahl_frames_unpack_encoder(&frame, &state);
    if (fault == FAULT_INVALID) {
        state.valid = false;
        f->expected.invalid++;
    } else {
        state.count = (int32_t)((uint32_t)state.count + 0x10000000u + splitmix_below(&f->random, 0x60000000u));
        f->expected.jump++;
        f->good_due = 1;
    }
    dahl_frames_pack_encoder(&frame, (uint8_t)(frame.id & ID_NUMBER), &state);
    count_lost(f);
    put(sink, &frame);
}

static void babble(faults_t *f, sink_t *sink)
{
    for (uint32_t i = 0; i < BABBLE_FRAMES; i++) {
        dahl_can_frame_t frame = {.id = ID_BABBLE + splitmix_below(&f->random, 0x10), .length = 8};
        for (size_t byte = 0; byte < 8; byte++) {
            frame.data[byte] = (uint8_t)splitmix_below(&f->random, 256);
        }
        put(sink, &frame);
    }
    f->expected.ignored += BABBLE_FRAMES;
}

static void restart(faults_t *f, const dahl_can_frame_t *frame, sink_t *sink)
{
    dahl_can_frame_t reset;
    dahl_frames_pack_reset(&reset, (uint8_t)(frame->id & ID_NUMBER), &(dahl_node_reset_t){.what = DAHL_FRAMES_RESET_RESTART});
    f->expected.resets++;
    put(sink, &reset);
}

static void silence(faults_t *f, const dahl_can_frame_t *frame, fault_t fault, sink_t *sink)
{
    (void)frame;
    (void)sink;
    f->reports_bus_off = fault == FAULT_BUS_OFF;
    f->off = f->off_ticks - 1;
    f->rearm = DAHL_NODE_REARM - 1;
    f->good_due = DAHL_NODE_REARM;
}

/* Silence, bus_off and restart break the sequence, so no frame may be late or missing then. */
static bool is_allowed(const faults_t *f, fault_t fault)
{
    bool is_break = fault == FAULT_SILENCE || fault == FAULT_BUS_OFF || fault == FAULT_RESTART;
    bool is_late = fault == FAULT_REORDER || fault == FAULT_DELAY;
    if (is_break && (f->late_count > 0 || f->missing > 0)) {
        return false;
    }
    return f->missing < MISSING_MAX && !(is_late && f->late_count == FAULTS_HELD);
}

/* Return FAULT_KINDS for no fault. */
static fault_t choose(faults_t *f)
{
    double chance = splitmix_unit(&f->random);
    fault_t fault = FAULT_DROP;
    while (fault < FAULT_KINDS && chance >= f->rates[fault]) {
        chance -= f->rates[fault++];
    }
    if (f->good_due > 0) {
        f->good_due--;
        return FAULT_KINDS;
    }
    return fault < FAULT_KINDS && is_allowed(f, fault) ? fault : FAULT_KINDS;
}

/* Faults that replace the frame. The others send it unchanged. */
static void (*const replacements[FAULT_KINDS + 1])(faults_t *, const dahl_can_frame_t *, fault_t, sink_t *) = {
    [FAULT_DROP] = drop,           [FAULT_REORDER] = hold,       [FAULT_DELAY] = hold,
    [FAULT_CORRUPT] = corrupt,     [FAULT_LENGTH] = change_form,  [FAULT_ID] = change_form,
    [FAULT_EXTENDED] = change_form, [FAULT_INVALID] = change_state, [FAULT_GLITCH] = change_state,
    [FAULT_SILENCE] = silence,     [FAULT_BUS_OFF] = silence,
};

static void pass_good(faults_t *f, const dahl_can_frame_t *frame, fault_t fault, sink_t *sink)
{
    if (fault == FAULT_BABBLE) {
        babble(f, sink);
    } else if (fault == FAULT_RESTART) {
        restart(f, frame, sink);
    }
    send_good(f, frame, sink);
    if (fault == FAULT_DUPLICATE) {
        f->expected.repeated++;
        put(sink, frame);
    }
}

/* Send the late frames that are due. */
static void release(faults_t *f, sink_t *sink)
{
    size_t kept = 0;
    for (size_t i = 0; i < f->late_count; i++) {
        if (f->late[i].wait-- == 0) {
            f->expected.wrong_sequence++;
            put(sink, &f->late[i].frame);
        } else {
            f->late[kept++] = f->late[i];
        }
    }
    f->late_count = kept;
}

/* Report bus-off after the frames on a slow bus have arrived. The silence ends after the timeout. */
static void stay_silent(faults_t *f, sink_t *sink)
{
    f->off--;
    if (f->reports_bus_off && f->off == f->off_ticks - BUS_OFF_TICKS) {
        put(sink, &(dahl_can_frame_t){.id = DAHL_CAN_ERROR_BUS_OFF, .flags = DAHL_CAN_FRAME_ERROR, .length = 8});
        f->expected.bus_off++;
    }
    f->expected.stale += !f->reports_bus_off && f->off == OFF_EXTRA - 1 ? 1u : 0u; /* the timeout has just passed */
}

size_t faults_pass(faults_t *f, const dahl_can_frame_t *in, dahl_can_frame_t out[FAULTS_OUT])
{
    sink_t sink = {out, 0};
    if (f->off > 0) {
        stay_silent(f, &sink);
        return sink.count;
    }
    fault_t fault = choose(f);
    if (fault < FAULT_KINDS) {
        f->injected[fault]++;
    }
    if (replacements[fault] != NULL) {
        replacements[fault](f, in, fault, &sink);
    } else {
        pass_good(f, in, fault, &sink);
    }
    release(f, &sink);
    return sink.count;
}

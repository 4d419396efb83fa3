/* SPDX-License-Identifier: MIT */
/* faults: see faults.h. One function per fault; each writes what is sent and what the node has to count. */
#include "faults.h"

#include "splitmix.h"

enum { RUN_MAX = 6, LATE_MIN = 2, LATE_MAX = 7, BABBLE = 8, OFF_EXTRA = 10, OFF_TOLD = 5, NOBODY = 0x700, BABBLER = 0x0F0 };

const char *const fault_names[FAULT_KINDS] = {
    [FAULT_DROP] = "drop",         [FAULT_DUPLICATE] = "duplicate", [FAULT_REORDER] = "reorder",
    [FAULT_DELAY] = "delay",       [FAULT_CORRUPT] = "corrupt",     [FAULT_LENGTH] = "length",
    [FAULT_ID] = "id",             [FAULT_EXTENDED] = "extended",   [FAULT_INVALID] = "invalid",
    [FAULT_GLITCH] = "glitch",     [FAULT_BABBLE] = "babble",       [FAULT_SILENCE] = "silence",
    [FAULT_BUS_OFF] = "bus_off",   [FAULT_RESTART] = "restart",
};

typedef struct {
    dahl_can_frame_t *frames;
    size_t count;
} sink_t;

void faults_open(faults_t *faults, const double rates[FAULT_KINDS], uint64_t seed, uint32_t timeout_us)
{
    *faults = (faults_t){
        .rates = rates, .random = seed, .off_ticks = timeout_us / 1000 + OFF_EXTRA, .clean = 1};
}

static void put(sink_t *sink, const dahl_can_frame_t *frame)
{
    sink->frames[sink->count++] = *frame;
}

/* The node sees a frame in sequence: what went missing before it is lost now. */
static void arrive(faults_t *f)
{
    f->expected.lost += f->missing;
    f->missing = 0;
}

static void good(faults_t *f, const dahl_can_frame_t *frame, sink_t *sink)
{
    arrive(f);
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
    f->clean = 1;
}

static void flip_bits(faults_t *f, dahl_can_frame_t *frame)
{
    uint64_t mask = 0;
    for (uint32_t flips = 1 + splitmix_below(&f->random, 3); flips > 0; flips--) {
        mask |= UINT64_C(1) << splitmix_below(&f->random, 64);
    }
    for (uint32_t i = 0; i < 8; i++) {
        frame->data[i] ^= (uint8_t)(mask >> (8 * i));
    }
}

static void corrupt(faults_t *f, const dahl_can_frame_t *frame, fault_t fault, sink_t *sink)
{
    dahl_encoder_state_t unused;
    dahl_can_frame_t spoiled;
    (void)fault;
    do {
        spoiled = *frame;
        flip_bits(f, &spoiled);
    } while (dahl_frames_unpack_encoder(&spoiled, &unused) == DAHL_FRAMES_GOOD);
    f->expected.crc++;
    f->missing++;
    put(sink, &spoiled);
}

static void spoil_form(faults_t *f, const dahl_can_frame_t *in, fault_t fault, sink_t *sink)
{
    dahl_can_frame_t frame = *in;
    if (fault == FAULT_ID) {
        frame.id = NOBODY + splitmix_below(&f->random, 0xFF);
        f->expected.ignored++;
    } else {
        frame.length = fault == FAULT_LENGTH ? (uint8_t)splitmix_below(&f->random, 8) : frame.length;
        frame.flags = fault == FAULT_EXTENDED ? DAHL_CAN_FRAME_EXTENDED : frame.flags;
        f->expected.format++;
    }
    f->missing++;
    put(sink, &frame);
}

/* Another content, with its CRC in order. */
static void spoil_count(faults_t *f, const dahl_can_frame_t *in, fault_t fault, sink_t *sink)
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
        f->clean = 1;
    }
    dahl_frames_pack_encoder(&frame, (uint8_t)(frame.id & 0x0F), &state);
    arrive(f);
    put(sink, &frame);
}

static void babble(faults_t *f, sink_t *sink)
{
    for (uint32_t i = 0; i < BABBLE; i++) {
        dahl_can_frame_t frame = {.id = BABBLER + splitmix_below(&f->random, 0x10), .length = 8};
        for (size_t byte = 0; byte < 8; byte++) {
            frame.data[byte] = (uint8_t)splitmix_below(&f->random, 256);
        }
        put(sink, &frame);
    }
    f->expected.ignored += BABBLE;
}

static void restart(faults_t *f, const dahl_can_frame_t *frame, sink_t *sink)
{
    dahl_can_frame_t reset;
    dahl_frames_pack_reset(&reset, (uint8_t)(frame->id & 0x0F), &(dahl_node_reset_t){.what = DAHL_FRAMES_RESET_RESTART});
    f->expected.resets++;
    put(sink, &reset);
}

static void silence(faults_t *f, const dahl_can_frame_t *frame, fault_t fault, sink_t *sink)
{
    (void)frame;
    (void)sink;
    f->told = fault == FAULT_BUS_OFF;
    f->silent++;
    f->off = f->off_ticks - 1;
    f->rearm = DAHL_NODE_REARM - 1;
    f->clean = DAHL_NODE_REARM;
}

/* Silence, bus_off and restart break the sequence, so nothing may be on its way or missing then. */
static bool may(const faults_t *f, fault_t fault)
{
    bool breaks = fault == FAULT_SILENCE || fault == FAULT_BUS_OFF || fault == FAULT_RESTART;
    bool late = fault == FAULT_REORDER || fault == FAULT_DELAY;
    if (breaks && (f->late_count > 0 || f->missing > 0)) {
        return false;
    }
    return f->missing < RUN_MAX && !(late && f->late_count == FAULTS_HELD);
}

static fault_t choose(faults_t *f)
{
    double chance = splitmix_unit(&f->random);
    fault_t fault = FAULT_DROP;
    while (fault < FAULT_KINDS && chance >= f->rates[fault]) {
        chance -= f->rates[fault++];
    }
    if (f->clean > 0) {
        f->clean--;
        return FAULT_KINDS;
    }
    return fault < FAULT_KINDS && may(f, fault) ? fault : FAULT_KINDS;
}

/* Faults after which this very frame does not come as it is; the others come beside it. */
static void (*const spoilers[FAULT_KINDS + 1])(faults_t *, const dahl_can_frame_t *, fault_t, sink_t *) = {
    [FAULT_DROP] = drop,           [FAULT_REORDER] = hold,       [FAULT_DELAY] = hold,
    [FAULT_CORRUPT] = corrupt,     [FAULT_LENGTH] = spoil_form,  [FAULT_ID] = spoil_form,
    [FAULT_EXTENDED] = spoil_form, [FAULT_INVALID] = spoil_count, [FAULT_GLITCH] = spoil_count,
    [FAULT_SILENCE] = silence,     [FAULT_BUS_OFF] = silence,
};

static void pass_good(faults_t *f, const dahl_can_frame_t *frame, fault_t fault, sink_t *sink)
{
    if (fault == FAULT_BABBLE) {
        babble(f, sink);
    } else if (fault == FAULT_RESTART) {
        restart(f, frame, sink);
    }
    good(f, frame, sink);
    if (fault == FAULT_DUPLICATE) {
        f->expected.repeated++;
        put(sink, frame);
    }
}

/* Late frames whose time has come. */
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

/* Bus-off is told when what was on its way on a slow bus has come; the timeout has passed before the silence ends. */
static void stay_silent(faults_t *f, sink_t *sink)
{
    f->off--;
    f->silent++;
    if (f->told && f->off == f->off_ticks - OFF_TOLD) {
        put(sink, &(dahl_can_frame_t){.id = DAHL_CAN_ERROR_BUS_OFF, .flags = DAHL_CAN_FRAME_ERROR, .length = 8});
        f->expected.bus_off++;
    }
    f->expected.stale += !f->told && f->off == OFF_EXTRA - 1 ? 1u : 0u; /* the timeout has just passed */
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
    if (spoilers[fault] != NULL) {
        spoilers[fault](f, in, fault, &sink);
    } else {
        pass_good(f, in, fault, &sink);
    }
    release(f, &sink);
    return sink.count;
}

/* SPDX-License-Identifier: MIT */
/* loop: see loop.h. */
#define _GNU_SOURCE
#include "loop.h"

#include <stddef.h>
#include <stdio.h>
#include <time.h>

#include "frame_bits.h"
#include "messages.h"

enum { SETTLE_TICKS = 1000, ALONE_TICKS = 100, WAIT_US = 10000, DRAIN_FRAMES = 1000, SECOND_TICKS = 1000 };

static const double LOAD_WARN = 0.7;

#define STALL_NS UINT64_C(1000000000)

static uint64_t read_clock(clockid_t id)
{
    struct timespec now;
    clock_gettime(id, &now);
    return (uint64_t)now.tv_sec * UINT64_C(1000000000) + (uint64_t)now.tv_nsec;
}

static uint64_t clock_now(void *context)
{
    const sim_clock_t *clock = (const sim_clock_t *)context;
    return clock->is_virtual ? clock->virtual_ns : clock->epoch_ns + read_clock(CLOCK_MONOTONIC);
}

static void clock_wait(void *context, uint32_t us)
{
    sim_clock_t *clock = (sim_clock_t *)context;
    struct timespec nap = {.tv_sec = (time_t)(us / 1000000u), .tv_nsec = (long)(us % 1000000u) * 1000};
    if (clock->is_virtual) {
        clock->virtual_ns += us * UINT64_C(1000);
    } else {
        nanosleep(&nap, NULL);
    }
}

void sim_clock_start(sim_clock_t *clock, bool is_virtual)
{
    clock->is_virtual = is_virtual;
    clock->virtual_ns = 0;
    clock->epoch_ns = read_clock(CLOCK_REALTIME) - read_clock(CLOCK_MONOTONIC);
}

dahl_can_clock_t sim_clock_seam(sim_clock_t *clock)
{
    return (dahl_can_clock_t){.now_ns = clock_now, .wait_us = clock_wait, .context = clock};
}

/* us; of real time the ticks that were made, and what has passed of the present one. */
static uint32_t node_time(const loop_t *loop)
{
    if (loop->clock->is_virtual) {
        return (uint32_t)(clock_now(loop->clock) / 1000u);
    }
    uint64_t since_ns = read_clock(CLOCK_MONOTONIC) - loop->ticked_ns;
    uint64_t part_ns = since_ns < LOOP_PERIOD_NS ? since_ns : LOOP_PERIOD_NS - 1;
    return (uint32_t)((loop->ticks * LOOP_PERIOD_NS + part_ns) / 1000u);
}

static void transmit(loop_t *loop, const dahl_can_frame_t *frame)
{
    dahl_can_result_t result = dahl_can_bus_send(loop->bus, frame);
    loop->send_failed += result == DAHL_CAN_BUS_OK ? 0u : 1u;
    loop->echoes += result == DAHL_CAN_BUS_OK ? 1u : 0u;
    loop->gone |= result == DAHL_CAN_BUS_GONE;
}

/* What nodes themselves sent is no input of theirs; of several nodes each sees what has its number. */
static bool is_for(const loop_t *loop, const dahl_node_t *node, const dahl_can_frame_t *frame)
{
    uint32_t kind = frame->id & 0x7F0u;
    bool answer = kind == DAHL_FRAMES_ID_TORQUE || kind == DAHL_FRAMES_ID_STATUS || kind == DAHL_FRAMES_ID_PARAM_REPLY;
    bool own_answer = (frame->flags & (DAHL_CAN_FRAME_OWN | DAHL_CAN_FRAME_EXTENDED)) == DAHL_CAN_FRAME_OWN && answer;
    if ((frame->flags & DAHL_CAN_FRAME_ERROR) != 0) {
        return dahl_can_is_bus_off(frame);
    }
    return !own_answer && (loop->node_count == 1 || (frame->id & 0x0Fu) == node->number);
}

static void to_nodes(loop_t *loop, const dahl_can_frame_t *frame)
{
    dahl_can_frame_t answer;
    for (uint32_t i = 0; i < loop->node_count; i++) {
        dahl_node_t *node = &loop->nodes[i];
        if (is_for(loop, node, frame) && dahl_node_receive(node, frame, node_time(loop), &answer)) {
            transmit(loop, &answer);
        }
    }
}

static void count_bus_bits(loop_t *loop, const dahl_can_frame_t *frame)
{
    uint64_t bits = can_frame_bits(frame);
    loop->bits += bits;
    loop->second_bits += bits;
}

static void dispatch(loop_t *loop, dahl_can_frame_t *frame)
{
    uint64_t now = clock_now(loop->clock);
    if (loop->clock->is_virtual) {
        frame->time_us = now / 1000u;
        loop->echoes -= (frame->flags & DAHL_CAN_FRAME_OWN) != 0 && loop->echoes > 0 ? 1u : 0u;
    }
    if (loop->log != NULL) {
        candump_write(loop->log, frame);
    }
    loop->error_frames += (frame->flags & DAHL_CAN_FRAME_ERROR) != 0 ? 1u : 0u;
    if (loop->bitrate > 0) {
        count_bus_bits(loop, frame);
    }
    for (uint32_t i = 0; i < loop->encoder_count; i++) {
        encoder_receive(&loop->encoders[i], frame, now);
    }
    loop->heard |= (frame->id & 0x7F0u) == DAHL_FRAMES_ID_ENCODER && loop->encoder_count == 0;
    loop->follows |= loop->heard;
    to_nodes(loop, frame);
}

static bool receive(loop_t *loop, uint32_t timeout_us)
{
    dahl_can_frame_t frame;
    dahl_can_result_t result = dahl_can_bus_receive(loop->bus, &frame, timeout_us);
    loop->gone |= result == DAHL_CAN_BUS_GONE;
    if (result == DAHL_CAN_BUS_OK) {
        dispatch(loop, &frame);
    }
    return result == DAHL_CAN_BUS_OK;
}

static double load_of(const loop_t *loop, uint64_t bits, uint64_t ticks)
{
    return (double)bits * (double)SECOND_TICKS / ((double)loop->bitrate * (double)ticks);
}

/* How full was the bus in the last so many ticks, a second of them or a whole run that is shorter? */
static void look_at_load(loop_t *loop, uint64_t ticks)
{
    double load = load_of(loop, loop->second_bits, ticks);
    if (load > LOAD_WARN && loop->peak_load <= LOAD_WARN) {
        char text[100];
        snprintf(text, sizeof text, "bus load %.0f %% at %u bit/s: above %.0f %%, frames will wait for each other",
                 100 * load, (unsigned)loop->bitrate, 100 * LOAD_WARN);
        log_warning(text);
    }
    loop->peak_load = load > loop->peak_load ? load : loop->peak_load;
    loop->second_bits = 0;
    loop->second_end = loop->ticks + SECOND_TICKS;
}

/* At the last tick: what still waits then takes time that is not of the run. */
static void sum_up_load(loop_t *loop)
{
    if (loop->bitrate > 0 && loop->ticks > 0) {
        loop->load = load_of(loop, loop->bits, loop->ticks);
        if (loop->ticks < SECOND_TICKS) {
            look_at_load(loop, loop->ticks);
        }
    }
}

/* An event of one node's controller; the others' do not see it. */
static void inject_controller_event(loop_t *loop, uint32_t number, dahl_can_frame_t *event)
{
    dahl_can_frame_t unused;
    event->time_us = clock_now(loop->clock) / 1000u;
    if (loop->log != NULL) {
        candump_write(loop->log, event);
    }
    loop->error_frames++;
    for (uint32_t i = 0; i < loop->node_count; i++) {
        if (loop->nodes[i].number == number) {
            dahl_node_receive(&loop->nodes[i], event, node_time(loop), &unused);
        }
    }
}

static void send_spoiled(loop_t *loop, const encoder_t *encoder, const dahl_can_frame_t *angle)
{
    dahl_can_frame_t frames[FAULTS_OUT];
    size_t count = faults_pass(encoder->faults, angle, frames);
    for (size_t i = 0; i < count; i++) {
        if ((frames[i].flags & DAHL_CAN_FRAME_ERROR) != 0) {
            inject_controller_event(loop, encoder->node, &frames[i]);
        } else {
            transmit(loop, &frames[i]);
        }
    }
}

static void send_angle(loop_t *loop, const encoder_t *encoder, const dahl_can_frame_t *angle)
{
    if (encoder->faults != NULL) {
        send_spoiled(loop, encoder, angle);
    } else {
        transmit(loop, angle);
    }
}

static void send_load(loop_t *loop, encoder_t *encoder)
{
    dahl_can_frame_t load;
    if (encoder_load(encoder, &load)) {
        transmit(loop, &load);
    }
}

static void send_status(loop_t *loop)
{
    dahl_can_frame_t status;
    for (uint32_t i = 0; i < loop->node_count; i++) {
        if (dahl_node_tick(&loop->nodes[i], node_time(loop), &status)) {
            transmit(loop, &status);
        }
    }
}

/* The first encoder decides when the motion has ended. */
static void tick(loop_t *loop)
{
    dahl_can_frame_t angles[DAHL_FRAMES_NODES];
    uint32_t ready = 0;
    while (ready < loop->encoder_count && encoder_tick(&loop->encoders[ready], clock_now(loop->clock), &angles[ready])) {
        ready++;
    }
    if (loop->encoder_count > 0 && ready == 0) {
        return;
    }
    loop->ticks++;
    loop->heard = false;
    send_status(loop);
    for (uint32_t i = 0; i < ready; i++) {
        send_load(loop, &loop->encoders[i]);
        send_angle(loop, &loop->encoders[i], &angles[i]);
    }
    if (loop->bitrate > 0 && loop->ticks >= loop->second_end) {
        look_at_load(loop, SECOND_TICKS);
    }
}

static bool is_idle(loop_t *loop)
{
    bool peers = loop->until_idle && loop->bus->ops->peers(loop->bus) > 0;
    loop->had_peers |= peers;
    return loop->until_idle && loop->had_peers && !peers;
}

static bool is_done(loop_t *loop)
{
    bool ended = loop->encoder_count > 0 && loop->encoders[0].ended;
    return *loop->stop || loop->gone || ended || loop->ticks >= loop->max_ticks || is_idle(loop);
}

static void wait_for_clients(loop_t *loop)
{
    while (!*loop->stop && !loop->gone && loop->bus->ops->peers(loop->bus) < loop->wait_clients) {
        receive(loop, WAIT_US);
    }
}

/* Take all that comes before `end_ns`: on a bus without a bit rate all that was sent, which takes no time. */
static void run_until(loop_t *loop, uint64_t end_ns)
{
    bool more = true;
    while (more && !loop->gone) {
        uint32_t left_us = (uint32_t)((end_ns - loop->clock->virtual_ns) / 1000u);
        more = receive(loop, loop->paced ? left_us : loop->echoes > 0 ? WAIT_US : 0);
    }
    loop->echoes = 0;
}

static void run_virtual(loop_t *loop)
{
    uint64_t end_ns = 0;
    while (!is_done(loop)) {
        tick(loop);
        end_ns += LOOP_PERIOD_NS;
        run_until(loop, end_ns);
        loop->clock->virtual_ns = end_ns;
    }
    sum_up_load(loop);
    for (uint64_t ticks = 0; loop->paced && ticks < ALONE_TICKS; ticks++) {
        run_until(loop, end_ns += LOOP_PERIOD_NS);
    }
}

static bool some_wait(const loop_t *loop)
{
    bool waits = false;
    for (uint32_t i = 0; i < loop->encoder_count; i++) {
        waits |= encoder_waits(&loop->encoders[i]);
    }
    return waits;
}

static bool some_answered(const loop_t *loop)
{
    bool answered = false;
    for (uint32_t i = 0; i < loop->encoder_count; i++) {
        answered |= loop->encoders[i].answered > 0;
    }
    return answered;
}

/* Give the last answers time to come, longer if there is somebody who answers. */
static void settle(loop_t *loop)
{
    uint64_t ticks = some_answered(loop) ? SETTLE_TICKS : ALONE_TICKS;
    uint64_t deadline = read_clock(CLOCK_MONOTONIC) + ticks * LOOP_PERIOD_NS;
    while (some_wait(loop) && !loop->gone && read_clock(CLOCK_MONOTONIC) < deadline) {
        receive(loop, 1000);
    }
}

/* What had come when the end came is still answered and logged; bounded, as a bus may never fall silent. */
static void drain(loop_t *loop)
{
    for (int i = 0; i < DRAIN_FRAMES && receive(loop, 0); i++) {
    }
}

/* Make the tick that is due; returns when to make the next. */
static uint64_t run_due_tick(loop_t *loop, uint64_t now)
{
    uint64_t soonest = now + LOOP_PERIOD_NS * 3 / 4;
    uint64_t late = now - loop->due_ns;
    histogram_add(&loop->late, late);
    loop->late_ticks += late > LOOP_PERIOD_NS && !loop->lockstep ? 1u : 0u;
    loop->ticked_ns = now;
    tick(loop);
    loop->due_ns += late > STALL_NS ? late + LOOP_PERIOD_NS : LOOP_PERIOD_NS;
    return loop->due_ns > soonest ? loop->due_ns : soonest;
}

/* Go on without the other side. */
static void give_up(loop_t *loop)
{
    for (uint32_t i = 0; i < loop->encoder_count; i++) {
        encoder_give_up(&loop->encoders[i]);
    }
    log_warning(loop->follows ? "no angle came for 2 s; the node's clock runs on"
                              : "an angle had no answer for 2 s; it is counted as lost");
    loop->follows = false;
}

/* In lockstep: is an answer or an angle still to come, and may it? */
static bool must_wait(loop_t *loop, uint64_t now)
{
    bool angle_due = loop->follows && !loop->heard;
    if (!loop->lockstep || !(angle_due || some_wait(loop))) {
        return false;
    }
    if (now - loop->ticked_ns < LOOP_PATIENCE_NS) {
        return true;
    }
    give_up(loop);
    return false;
}

static uint32_t us_until(uint64_t next)
{
    uint64_t now = read_clock(CLOCK_MONOTONIC);
    return next > now ? (uint32_t)((next - now) / 1000u) : 0;
}

static void run_real(loop_t *loop)
{
    uint64_t next = read_clock(CLOCK_MONOTONIC);
    loop->due_ns = next;
    while (!is_done(loop)) {
        uint64_t now = read_clock(CLOCK_MONOTONIC);
        bool waits = must_wait(loop, now);
        if (now >= next && !waits) {
            next = run_due_tick(loop, now);
        }
        receive(loop, now >= next && waits ? WAIT_US : us_until(next));
    }
    sum_up_load(loop);
    if (loop->encoder_count > 0) {
        settle(loop);
    }
    drain(loop);
}

void loop_run(loop_t *loop)
{
    loop->second_end = SECOND_TICKS;
    wait_for_clients(loop);
    uint64_t start = read_clock(CLOCK_MONOTONIC);
    if (loop->clock->is_virtual) {
        run_virtual(loop);
    } else {
        run_real(loop);
    }
    loop->wall_ns = read_clock(CLOCK_MONOTONIC) - start;
}

/* SPDX-License-Identifier: MIT */
#define _GNU_SOURCE
#include "loop.h"

#include <stddef.h>
#include <time.h>

#include "stderr_messages.h"

enum { ID_KIND = 0x7F0, ID_NUMBER = 0x00F };
enum {
    SETTLE_TICKS = 1000,    /* for the last answers, if nodes have answered before */
    UNANSWERED_TICKS = 100, /* the same if no node has answered yet */
    WAIT_US = 10000,        /* of one receive() while the loop waits for other programs */
    MAX_DRAIN_FRAMES = 1000 /* that are received after the run */
};

#define CATCH_UP_NS (PERIOD_NS * 3 / 4) /* from a late tick to the next */
#define STALL_NS NS_PER_S

static uint64_t read_clock(clockid_t id)
{
    struct timespec now;
    clock_gettime(id, &now);
    return (uint64_t)now.tv_sec * NS_PER_S + (uint64_t)now.tv_nsec;
}

static uint64_t clock_now(void *context)
{
    const sim_clock_t *clock = (const sim_clock_t *)context;
    return clock->is_virtual ? clock->virtual_ns : clock->epoch_ns + read_clock(CLOCK_MONOTONIC);
}

static void clock_wait(void *context, uint32_t us)
{
    sim_clock_t *clock = (sim_clock_t *)context;
    struct timespec nap = {.tv_sec = (time_t)(us / US_PER_S), .tv_nsec = (long)(us % US_PER_S * NS_PER_US)};
    if (clock->is_virtual) {
        clock->virtual_ns += us * NS_PER_US;
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

dahl_can_clock_t sim_clock_interface(sim_clock_t *clock)
{
    return (dahl_can_clock_t){.now_ns = clock_now, .wait_us = clock_wait, .context = clock};
}

/* Time of the nodes, us. In real time: all ticks so far, and the time since the last one, up to one period. */
static uint32_t node_time(const loop_t *loop)
{
    if (loop->clock->is_virtual) {
        return (uint32_t)(clock_now(loop->clock) / NS_PER_US);
    }
    uint64_t since_ns = read_clock(CLOCK_MONOTONIC) - loop->last_tick_ns;
    uint64_t part_ns = since_ns < PERIOD_NS ? since_ns : PERIOD_NS - 1;
    return (uint32_t)((loop->ticks * PERIOD_NS + part_ns) / NS_PER_US);
}

static void transmit(loop_t *loop, const dahl_can_frame_t *frame)
{
    dahl_can_result_t result = dahl_can_bus_send(loop->bus, frame);
    loop->send_failed += result == DAHL_CAN_BUS_OK ? 0u : 1u;
    loop->echoes += result == DAHL_CAN_BUS_OK ? 1u : 0u;
    loop->is_bus_gone |= result == DAHL_CAN_BUS_GONE;
}

/* Nodes do not receive answers of this process. Of several nodes, each receives frames with its number only. */
static bool is_for(const loop_t *loop, const dahl_node_t *node, const dahl_can_frame_t *frame)
{
    uint32_t kind = frame->id & ID_KIND;
    bool is_answer = kind == DAHL_FRAMES_ID_TORQUE || kind == DAHL_FRAMES_ID_STATUS || kind == DAHL_FRAMES_ID_PARAM_REPLY;
    bool is_own = (frame->flags & (DAHL_CAN_FRAME_OWN | DAHL_CAN_FRAME_EXTENDED)) == DAHL_CAN_FRAME_OWN;
    if ((frame->flags & DAHL_CAN_FRAME_ERROR) != 0) {
        return dahl_can_is_bus_off(frame);
    }
    return !(is_own && is_answer) && (loop->node_count == 1 || (frame->id & ID_NUMBER) == node->number);
}

static void pass_to_nodes(loop_t *loop, const dahl_can_frame_t *frame)
{
    dahl_can_frame_t answer;
    for (uint32_t i = 0; i < loop->node_count; i++) {
        dahl_node_t *node = &loop->nodes[i];
        if (is_for(loop, node, frame) && dahl_node_receive(node, frame, node_time(loop), &answer)) {
            transmit(loop, &answer);
        }
    }
}

static void count_flags(loop_t *loop, uint32_t flags)
{
    loop->error_frames += (flags & DAHL_CAN_FRAME_ERROR) != 0 ? 1u : 0u;
    loop->cut_frames += (flags & DAHL_CAN_FRAME_CUT) != 0 ? 1u : 0u;
}

static void dispatch(loop_t *loop, dahl_can_frame_t *frame)
{
    uint64_t now = clock_now(loop->clock);
    if (loop->clock->is_virtual) {
        frame->time_us = now / NS_PER_US;
        loop->echoes -= (frame->flags & DAHL_CAN_FRAME_OWN) != 0 && loop->echoes > 0 ? 1u : 0u;
    }
    if (loop->log != NULL) {
        candump_write(loop->log, frame);
    }
    count_flags(loop, frame->flags);
    for (uint32_t i = 0; i < loop->encoder_count; i++) {
        encoder_receive(&loop->encoders[i], frame, now);
    }
    loop->has_count |= (frame->id & ID_KIND) == DAHL_FRAMES_ID_ENCODER && loop->encoder_count == 0;
    loop->waits_for_encoder |= loop->has_count;
    pass_to_nodes(loop, frame);
}

static bool receive(loop_t *loop, uint32_t timeout_us)
{
    dahl_can_frame_t frame;
    dahl_can_result_t result = dahl_can_bus_receive(loop->bus, &frame, timeout_us);
    loop->is_bus_gone |= result == DAHL_CAN_BUS_GONE;
    if (result == DAHL_CAN_BUS_OK) {
        dispatch(loop, &frame);
    }
    return result == DAHL_CAN_BUS_OK;
}

/* An event of one node's controller; the other nodes do not receive it. */
static void inject_controller_event(loop_t *loop, uint32_t number, dahl_can_frame_t *event)
{
    dahl_can_frame_t unused;
    event->time_us = clock_now(loop->clock) / NS_PER_US;
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

static void send_with_faults(loop_t *loop, const encoder_t *encoder, const dahl_can_frame_t *count)
{
    dahl_can_frame_t frames[FAULTS_OUT];
    size_t frame_count = faults_pass(encoder->faults, count, frames);
    for (size_t i = 0; i < frame_count; i++) {
        if ((frames[i].flags & DAHL_CAN_FRAME_ERROR) != 0) {
            inject_controller_event(loop, encoder->node, &frames[i]);
        } else {
            transmit(loop, &frames[i]);
        }
    }
}

static void send_count(loop_t *loop, const encoder_t *encoder, const dahl_can_frame_t *count)
{
    if (encoder->faults != NULL) {
        send_with_faults(loop, encoder, count);
    } else {
        transmit(loop, count);
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

/* If no encoder has a count, the motion has ended, and there is no tick. */
static void tick(loop_t *loop)
{
    dahl_can_frame_t counts[DAHL_FRAMES_NODES];
    uint32_t ready = 0;
    while (ready < loop->encoder_count && encoder_tick(&loop->encoders[ready], clock_now(loop->clock), &counts[ready])) {
        ready++;
    }
    if (loop->encoder_count > 0 && ready == 0) {
        return;
    }
    loop->ticks++;
    loop->has_count = false;
    send_status(loop);
    for (uint32_t i = 0; i < ready; i++) {
        send_load(loop, &loop->encoders[i]);
        send_count(loop, &loop->encoders[i], &counts[i]);
    }
}

static bool is_idle(loop_t *loop)
{
    bool has_peers = loop->until_idle && loop->bus->ops->peers(loop->bus) > 0;
    loop->has_had_peers |= has_peers;
    return loop->until_idle && loop->has_had_peers && !has_peers;
}

/* The first encoder decides when the motion has ended. */
static bool is_done(loop_t *loop)
{
    bool has_ended = loop->encoder_count > 0 && loop->encoders[0].has_ended;
    return *loop->stop || loop->is_bus_gone || has_ended || loop->ticks >= loop->max_ticks || is_idle(loop);
}

static void wait_for_clients(loop_t *loop)
{
    while (!*loop->stop && !loop->is_bus_gone && loop->bus->ops->peers(loop->bus) < loop->wait_clients) {
        receive(loop, WAIT_US);
    }
}

/* Receive all frames that were sent. */
static void receive_all(loop_t *loop)
{
    while (!loop->is_bus_gone && receive(loop, loop->echoes > 0 ? WAIT_US : 0)) {
    }
    loop->echoes = 0;
}

static void run_virtual(loop_t *loop)
{
    uint64_t end_ns = 0;
    while (!is_done(loop)) {
        tick(loop);
        receive_all(loop);
        end_ns += PERIOD_NS;
        loop->clock->virtual_ns = end_ns;
    }
}

static bool has_unanswered(const loop_t *loop)
{
    bool is_found = false;
    for (uint32_t i = 0; i < loop->encoder_count; i++) {
        is_found |= encoder_waits(&loop->encoders[i]);
    }
    return is_found;
}

static bool has_answers(const loop_t *loop)
{
    bool is_found = false;
    for (uint32_t i = 0; i < loop->encoder_count; i++) {
        is_found |= loop->encoders[i].answered > 0;
    }
    return is_found;
}

/* Wait for the last answers; longer if a node has answered before. */
static void settle(loop_t *loop)
{
    uint64_t ticks = has_answers(loop) ? SETTLE_TICKS : UNANSWERED_TICKS;
    uint64_t deadline = read_clock(CLOCK_MONOTONIC) + ticks * PERIOD_NS;
    while (has_unanswered(loop) && !loop->is_bus_gone && read_clock(CLOCK_MONOTONIC) < deadline) {
        receive(loop, PERIOD_US);
    }
}

/* Answer and log the frames that have already arrived. A busy bus may never be silent, so their number is limited. */
static void drain(loop_t *loop)
{
    for (int i = 0; i < MAX_DRAIN_FRAMES && receive(loop, 0); i++) {
    }
}

/* Run the tick that is due. Returns the time of the next one. */
static uint64_t run_due_tick(loop_t *loop, uint64_t now)
{
    uint64_t soonest = now + CATCH_UP_NS;
    uint64_t late = now - loop->due_ns;
    histogram_add(&loop->late, late);
    loop->late_ticks += late > PERIOD_NS && !loop->is_lockstep ? 1u : 0u;
    loop->last_tick_ns = now;
    tick(loop);
    loop->due_ns += late > STALL_NS ? late + PERIOD_NS : PERIOD_NS;
    return loop->due_ns > soonest ? loop->due_ns : soonest;
}

/* End a lockstep wait: go on without the missing answers, or let the node's clock run. */
static void give_up(loop_t *loop)
{
    for (uint32_t i = 0; i < loop->encoder_count; i++) {
        encoder_give_up(&loop->encoders[i]);
    }
    log_note(loop->waits_for_encoder ? "no count came for %d s; the node's clock runs on"
                                     : "a count had no answer for %d s; the encoder goes on without it",
             LOOP_PATIENCE_S);
    loop->waits_for_encoder = false;
}

/* In lockstep: is an answer or a count missing, and is its time not over? */
static bool must_wait(loop_t *loop, uint64_t now)
{
    bool is_count_due = loop->waits_for_encoder && !loop->has_count;
    if (!loop->is_lockstep || !(is_count_due || has_unanswered(loop))) {
        return false;
    }
    if (now - loop->last_tick_ns < LOOP_PATIENCE_NS) {
        return true;
    }
    give_up(loop);
    return false;
}

static uint32_t us_until(uint64_t next)
{
    uint64_t now = read_clock(CLOCK_MONOTONIC);
    return next > now ? (uint32_t)((next - now) / NS_PER_US) : 0;
}

static void run_real(loop_t *loop)
{
    uint64_t next = read_clock(CLOCK_MONOTONIC);
    loop->due_ns = next;
    while (!is_done(loop)) {
        uint64_t now = read_clock(CLOCK_MONOTONIC);
        bool is_waiting = must_wait(loop, now);
        if (now >= next && !is_waiting) {
            next = run_due_tick(loop, now);
        }
        receive(loop, now >= next && is_waiting ? WAIT_US : us_until(next));
    }
    if (loop->encoder_count > 0) {
        settle(loop);
    }
    drain(loop);
}

void loop_run(loop_t *loop)
{
    wait_for_clients(loop);
    uint64_t start = read_clock(CLOCK_MONOTONIC);
    if (loop->clock->is_virtual) {
        run_virtual(loop);
    } else {
        run_real(loop);
    }
    loop->wall_ns = read_clock(CLOCK_MONOTONIC) - start;
}

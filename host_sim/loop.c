/* SPDX-License-Identifier: MIT */
/* loop: see loop.h. */
#define _GNU_SOURCE
#include "loop.h"

#include <stddef.h>
#include <time.h>

#include "complain.h"

enum { SETTLE_TICKS = 1000, ALONE_TICKS = 100, WAIT_US = 10000, DRAIN_FRAMES = 1000 };

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
    const sim_clock_t *clock = (const sim_clock_t *)context;
    struct timespec nap = {.tv_sec = (time_t)(us / 1000000u), .tv_nsec = (long)(us % 1000000u) * 1000};
    if (!clock->is_virtual) {
        nanosleep(&nap, NULL);
    }
}

void sim_clock_start(sim_clock_t *clock, bool is_virtual)
{
    clock->is_virtual = is_virtual;
    clock->virtual_ns = 0;
    clock->epoch_ns = read_clock(CLOCK_REALTIME) - read_clock(CLOCK_MONOTONIC);
}

can_clock_t sim_clock_seam(sim_clock_t *clock)
{
    return (can_clock_t){.now_ns = clock_now, .wait_us = clock_wait, .context = clock};
}

static uint32_t node_time(const loop_t *loop)
{
    return (uint32_t)(clock_now(loop->clock) / 1000u);
}

static void transmit(loop_t *loop, const can_frame_t *frame)
{
    can_result_t result = can_bus_send(loop->bus, frame);
    loop->send_failed += result == CAN_BUS_OK ? 0u : 1u;
    loop->gone |= result == CAN_BUS_GONE;
}

/* What the node itself sent is no input of it. */
static bool is_for_node(const loop_t *loop, const can_frame_t *frame)
{
    bool own_answer = (frame->flags & CAN_FRAME_OWN) != 0 && (frame->id & 0x7F0u) != FRAMES_ID_ENCODER;
    return loop->node != NULL && !own_answer;
}

static void dispatch(loop_t *loop, const can_frame_t *frame)
{
    can_frame_t answer;
    if (loop->log != NULL) {
        candump_write(loop->log, frame);
    }
    if (loop->encoder != NULL) {
        encoder_receive(loop->encoder, frame, clock_now(loop->clock));
    }
    if (is_for_node(loop, frame) && node_receive(loop->node, frame, node_time(loop), &answer)) {
        transmit(loop, &answer);
    }
}

static bool receive(loop_t *loop, uint32_t timeout_us)
{
    can_frame_t frame;
    can_result_t result = can_bus_receive(loop->bus, &frame, timeout_us);
    loop->gone |= result == CAN_BUS_GONE;
    if (result == CAN_BUS_OK) {
        dispatch(loop, &frame);
    }
    return result == CAN_BUS_OK;
}

static void tick(loop_t *loop)
{
    can_frame_t angle;
    can_frame_t status;
    if (loop->encoder != NULL && !encoder_tick(loop->encoder, clock_now(loop->clock), &angle)) {
        return;
    }
    loop->ticks++;
    if (loop->node != NULL && node_tick(loop->node, node_time(loop), &status)) {
        transmit(loop, &status);
    }
    if (loop->encoder != NULL) {
        transmit(loop, &angle);
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
    bool ended = loop->encoder != NULL && loop->encoder->ended;
    return *loop->stop || loop->gone || ended || loop->ticks >= loop->max_ticks || is_idle(loop);
}

static void wait_for_clients(loop_t *loop)
{
    while (!*loop->stop && !loop->gone && loop->bus->ops->peers(loop->bus) < loop->wait_clients) {
        receive(loop, WAIT_US);
    }
}

static void run_virtual(loop_t *loop)
{
    while (!is_done(loop)) {
        tick(loop);
        while (receive(loop, 0)) {
        }
        loop->clock->virtual_ns += LOOP_PERIOD_NS;
    }
}

/* Give the last answers time to come, longer if there is somebody who answers. */
static void settle(loop_t *loop)
{
    uint64_t ticks = loop->encoder->answered > 0 ? SETTLE_TICKS : ALONE_TICKS;
    uint64_t give_up = read_clock(CLOCK_MONOTONIC) + ticks * LOOP_PERIOD_NS;
    while (encoder_waits(loop->encoder) && !loop->gone && read_clock(CLOCK_MONOTONIC) < give_up) {
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
static uint64_t beat(loop_t *loop, uint64_t now)
{
    uint64_t soonest = now + LOOP_PERIOD_NS * 3 / 4;
    uint64_t late = now - loop->due_ns;
    histogram_add(&loop->late, late);
    loop->ticked_ns = now;
    tick(loop);
    loop->due_ns += late > STALL_NS ? late + LOOP_PERIOD_NS : LOOP_PERIOD_NS;
    return loop->due_ns > soonest ? loop->due_ns : soonest;
}

/* In lockstep: is an answer still to come, and may it? */
static bool must_wait(loop_t *loop, uint64_t now)
{
    if (!loop->lockstep || loop->encoder == NULL || !encoder_waits(loop->encoder)) {
        return false;
    }
    if (now - loop->ticked_ns < LOOP_PATIENCE_NS) {
        return true;
    }
    encoder_give_up(loop->encoder);
    remark("an angle had no answer for 2 s; it is counted as lost");
    return false;
}

static void run_real(loop_t *loop)
{
    uint64_t next = read_clock(CLOCK_MONOTONIC);
    loop->due_ns = next;
    while (!is_done(loop)) {
        uint64_t now = read_clock(CLOCK_MONOTONIC);
        bool waits = must_wait(loop, now);
        if (now >= next && !waits) {
            next = beat(loop, now);
            now = read_clock(CLOCK_MONOTONIC);
        }
        receive(loop, next > now ? (uint32_t)((next - now) / 1000u) : waits ? WAIT_US : 0);
    }
    if (loop->encoder != NULL) {
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

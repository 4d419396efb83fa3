/* SPDX-License-Identifier: MIT */
/*
 * loop: run one tick each PERIOD_US. Between ticks, pass each frame of the bus to the nodes, the encoders and the log. Up to 16
 * nodes and encoders share the bus.
 *
 * docs/loop.md (Timing) describes the clocks. In real time, late ticks follow each other after 3/4 of a period until the
 * schedule is met again; a stall of more than a second shifts the schedule. Lockstep waits LOOP_PATIENCE_NS at most. In virtual
 * time, the clock stands still between ticks.
 */
#ifndef LOOP_H
#define LOOP_H

#include <signal.h>
#include <stdbool.h>
#include <stdint.h>

#include "dahl_can_bus.h"
#include "candump.h"
#include "encoder_node.h"
#include "histogram.h"
#include "dahl_node.h"
#include "timing.h"

#define LOOP_PATIENCE_S 2
#define LOOP_PATIENCE_NS (LOOP_PATIENCE_S * NS_PER_S)

/* The clock of a run; dahl_can_clock_t of the bus points to it. */
typedef struct {
    bool is_virtual;
    uint64_t virtual_ns;
    uint64_t epoch_ns; /* real time: wall clock minus monotonic clock at the start */
} sim_clock_t;

typedef struct {
    sim_clock_t *clock;
    dahl_can_bus_t *bus;
    dahl_node_t *nodes;
    uint32_t node_count;
    encoder_t *encoders;
    uint32_t encoder_count;
    candump_t *log;
    volatile sig_atomic_t *stop; /* set by a signal handler: end early, with whole files */
    uint64_t max_ticks;          /* UINT64_MAX: no limit */
    uint32_t wait_clients;       /* clients to wait for before the first tick */
    bool until_idle;             /* end when all clients have left */
    bool is_lockstep;
    bool is_bus_gone;
    bool has_had_peers;
    bool waits_for_encoder; /* node without an encoder: a count has come since the last time-out of lockstep */
    bool has_count;         /* the same: a count has come since the last tick */
    uint64_t ticks;
    uint64_t due_ns;        /* schedule of the next tick; real time */
    uint64_t last_tick_ns;  /* real time */
    uint64_t wall_ns;       /* duration of the run */
    uint64_t send_failed;   /* frames that the bus rejected */
    uint64_t error_frames;
    uint64_t cut_frames;    /* CAN FD frames of more than 8 bytes */
    uint64_t echoes;        /* own frames that have not come back yet; virtual time */
    histogram_t late;       /* lateness of ticks; real time */
    uint64_t late_ticks;    /* ticks that missed their deadline; real time */
} loop_t;

/* Start at 0 in virtual time, else at the real-time clock. */
void sim_clock_start(sim_clock_t *clock, bool is_virtual);

/* The clock as buses read it. *clock must live as long as they do. */
dahl_can_clock_t sim_clock_interface(sim_clock_t *clock);

void loop_run(loop_t *loop);

/* Time of all ticks, s. */
static inline double loop_seconds(const loop_t *loop)
{
    return (double)(loop->ticks * PERIOD_NS) * 1e-9;
}

#endif

/* SPDX-License-Identifier: MIT */
/*
 * loop: once per millisecond each part gets its tick; in between, frames go to the parts that want them, and every frame of
 * the bus goes to the log. A part that is not there is not run. Up to 16 nodes and encoders share the bus.
 *
 * Real time: ticks are kept by the monotonic clock. After a stall of the machine they come a third faster until they have
 * caught up: none is skipped, and they are never bunched. A stall of more than a second is not made up for. A tick that comes
 * more than a period late has missed its deadline, but in lockstep: there it may have waited for the other side.
 * A node's clock counts ticks: a program that the machine stalls has missed no time, as a core that is halted has not.
 * In lockstep a tick also waits for the other side: that of an encoder for the answer to the one before it, so that a slow
 * node outside loses nothing; that of a node alone for the next angle, so that no stall of the machine is a timeout. Both
 * for LOOP_PATIENCE_NS at most.
 * Virtual time: the next tick comes when nothing is left to be received; the clock stands still in between, but for the
 * time that frames take on a bus with a bit rate.
 */
#ifndef LOOP_H
#define LOOP_H

#include <signal.h>
#include <stdbool.h>
#include <stdint.h>

#include "dahl_can_bus.h"
#include "candump.h"
#include "encoder.h"
#include "histogram.h"
#include "dahl_node.h"

#define LOOP_PERIOD_NS ENCODER_PERIOD_NS
#define LOOP_PATIENCE_NS UINT64_C(2000000000)

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
    volatile sig_atomic_t *stop; /* set by a signal handler: end early, but whole */
    uint32_t bitrate;            /* for the load of the bus; 0: not looked at */
    bool paced;                  /* frames take time on the bus */
    uint64_t max_ticks;          /* UINT64_MAX: no limit */
    uint32_t wait_clients;       /* start when so many are on the bus */
    bool until_idle;             /* end when all clients have left */
    bool lockstep;               /* no tick while the other side is waited for */
    bool gone;                   /* the bus went away */
    bool had_peers;
    bool follows;         /* a node alone has heard an angle since its clock last ran without */
    bool heard;           /* the same since the last tick */
    uint64_t ticks;
    uint64_t due_ns;      /* when the next tick should come; real time */
    uint64_t ticked_ns;   /* when the last one came; real time */
    uint64_t wall_ns;     /* time that the run took */
    uint64_t send_failed; /* frames that the bus did not take */
    uint64_t error_frames;
    uint64_t echoes;      /* own frames that have not come back yet; virtual time */
    uint64_t bits;        /* that the frames seen took on the bus */
    uint64_t second_bits; /* in the present second */
    uint64_t second_end;  /* tick */
    double load;          /* of the bus, over the whole run */
    double peak_load;     /* of the fullest second */
    histogram_t late;     /* of ticks, real time */
    uint64_t late_ticks;  /* that missed their deadline; real time */
} loop_t;

void sim_clock_start(sim_clock_t *clock, bool is_virtual);
dahl_can_clock_t sim_clock_seam(sim_clock_t *clock);

void loop_run(loop_t *loop);

#endif

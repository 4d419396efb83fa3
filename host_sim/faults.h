/* SPDX-License-Identifier: MIT */
/*
 * faults: inject faults into the EncoderState frames of an encoder, with given rates and a seed. keys.csv lists the
 * faults and the counters of the node that each increments. A frame has one fault at most. `expected`
 * holds the counts that the node must have, so that both can be compared.
 *
 * No fault may hide another one. At most 6 consecutive frames are missing. A good frame follows each late frame, glitch and
 * restart. A good frame precedes silence, bus_off and restart. The bus-off event goes to the controller of a node in this
 * process only; a node elsewhere receives the silence.
 */
#ifndef FAULTS_H
#define FAULTS_H

#include <stddef.h>

#include "dahl_can_bus.h"
#include "dahl_frames.h"
#include "dahl_node.h"

typedef enum {
#define RUN_FAULT(NAME, name) FAULT_##NAME,
#include "run_keys.def"
    FAULT_KINDS
} fault_t;

extern const char *const fault_names[FAULT_KINDS];

#define FAULTS_HELD 8u /* late frames at once */
#define FAULTS_OUT 24u /* frames sent for one, at most */

typedef struct {
    dahl_can_frame_t frame;
    uint32_t wait; /* frames to send before it */
} fault_late_t;

typedef struct {
    const double *rates; /* shares of all frames, by fault_t */
    uint64_t random;
    uint32_t off_ticks; /* duration of silence and bus_off */
    uint64_t injected[FAULT_KINDS];
    dahl_node_counts_t expected; /* of the node, after all that was sent so far */
    uint32_t off;          /* ticks left of the present silence */
    bool reports_bus_off;  /* the present silence is a bus_off */
    uint32_t rearm;        /* good frames left until the node answers again */
    uint32_t good_due;     /* frames left that must have no fault */
    uint32_t missing;      /* consecutive frames that the node has not received */
    fault_late_t late[FAULTS_HELD];
    size_t late_count;
} faults_t;

/* timeout_us: of the node. *rates must stay valid. */
void faults_open(faults_t *faults, const double rates[FAULT_KINDS], uint64_t seed, uint32_t timeout_us);

/* Write the frames to send in place of an EncoderState to out, in order, and return their number. An error frame is an event
 * for the controller of the node with this number. */
size_t faults_pass(faults_t *f, const dahl_can_frame_t *in, dahl_can_frame_t out[FAULTS_OUT]);

#endif

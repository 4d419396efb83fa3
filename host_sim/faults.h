/* SPDX-License-Identifier: MIT */
/*
 * faults: what can happen to the frames of an encoder on their way, by rates and a seed. Each frame meets one fault at
 * most, and each fault is of a kind that the node must count; faults says how much the node has to have counted, so that
 * both can be compared to the last one:
 *
 *   | fault     | what happens                                                      | counted as              |
 *   |-----------|-------------------------------------------------------------------|-------------------------|
 *   | drop      | the frame does not come                                           | lost                    |
 *   | duplicate | it comes twice                                                    | repeated                |
 *   | reorder   | it comes after the next one                                       | lost, wrong_sequence    |
 *   | delay     | it comes 2 to 7 frames late                                       | lost, wrong_sequence    |
 *   | corrupt   | 1 to 3 of its bits are flipped, so that the CRC shows it          | lost, crc               |
 *   | length    | it is cut to 0 to 7 bytes                                         | lost, format            |
 *   | id        | it has an id that is nobody's                                     | lost, ignored           |
 *   | extended  | it has an id of 29 bits                                           | lost, format            |
 *   | invalid   | the encoder disowns its count                                     | invalid                 |
 *   | glitch    | its count is 2^28 counts and more away                            | jump                    |
 *   | babble    | 8 frames of nobody with high priority before it                   | ignored                 |
 *   | silence   | nothing is sent for longer than the node's timeout                | stale, rearm            |
 *   | bus_off   | the same, and the node's controller soon says that it is bus-off  | bus_off, rearm          |
 *   | restart   | the node starts anew, in the middle of the stream                 | resets                  |
 *
 * So that no fault hides another one: at most 6 frames in a row go missing; a frame that will come late, a glitch and a
 * new start are each followed by a good one; silence, bus_off and restart follow a good one. That a controller is off is
 * an event of its own and no frame: a node that runs elsewhere only hears the silence.
 */
#ifndef FAULTS_H
#define FAULTS_H

#include <stddef.h>

#include "dahl_can_bus.h"
#include "dahl_frames.h"
#include "dahl_node.h"

typedef enum {
    FAULT_DROP,
    FAULT_DUPLICATE,
    FAULT_REORDER,
    FAULT_DELAY,
    FAULT_CORRUPT,
    FAULT_LENGTH,
    FAULT_ID,
    FAULT_EXTENDED,
    FAULT_INVALID,
    FAULT_GLITCH,
    FAULT_BABBLE,
    FAULT_SILENCE,
    FAULT_BUS_OFF,
    FAULT_RESTART,
    FAULT_KINDS
} fault_t;

extern const char *const fault_names[FAULT_KINDS];

#define FAULTS_HELD 8u /* frames on their late way at once */
#define FAULTS_OUT 24u /* frames that one can become */

typedef struct {
    dahl_can_frame_t frame;
    uint32_t wait; /* frames still to pass before it */
} fault_late_t;

typedef struct {
    const double *rates; /* part of all frames, by fault_t */
    uint64_t random;
    uint32_t off_ticks; /* how long silence and bus_off last */
    uint64_t injected[FAULT_KINDS];
    uint64_t silent;       /* frames that silence and bus_off swallowed */
    dahl_node_counts_t expected; /* of the node, after all that was sent so far */
    uint32_t off;          /* frames still to swallow */
    bool told;             /* of this silence the node knows */
    uint32_t rearm;        /* good frames that the node still wants before it starts again */
    uint32_t clean;        /* frames still to leave alone */
    uint32_t missing;      /* frames in a row that the node has not seen */
    fault_late_t late[FAULTS_HELD];
    size_t late_count;
} faults_t;

/* timeout_us: of the node. *rates must outlive the faults. */
void faults_open(faults_t *faults, const double rates[FAULT_KINDS], uint64_t seed, uint32_t timeout_us);

/* What becomes of an EncoderState: the number of frames written to out, in the order of sending; an error frame is for
 * the controller of its node alone. */
size_t faults_pass(faults_t *f, const dahl_can_frame_t *in, dahl_can_frame_t out[FAULTS_OUT]);

#endif

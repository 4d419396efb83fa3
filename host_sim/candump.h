/* SPDX-License-Identifier: MIT */
/*
 * candump: write a log of the bus in the format of candump -L, which canplayer reads. The log has whole lines only, at any
 * moment and however the program ends. If a disk is full, the last incomplete line is removed.
 *
 * The log never delays a tick. If the reader of a pipe is slow, CANDUMP_ROOM bytes are buffered: 2 to 3 s of an angle and an
 * answer at 1 kHz. If the buffer is full, whole lines are omitted and counted. A patient log (virtual time, in which no tick
 * can be late) waits for its reader instead, CANDUMP_PATIENCE_MS at most.
 */
#ifndef CANDUMP_H
#define CANDUMP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dahl_can_bus.h"

#define CANDUMP_ROOM 262144u
#define CANDUMP_PATIENCE_MS 10000

typedef struct {
    int fd;
    const char *bus_name;
    bool is_patient;
    int why;          /* errno of a failed write; 0: no failure */
    uint64_t missing; /* lines that could not be written */
    uint64_t cut;     /* CAN FD frames of more than 8 bytes, which have no line */
    size_t torn;      /* bytes of an incomplete line at the end of the file */
    size_t used;      /* bytes in the buffer */
    char bytes[CANDUMP_ROOM];
} candump_t;

/* A named pipe must have a reader within 2 s. Returns false with errno set on failure; ENXIO: the pipe has no reader. */
bool candump_open(candump_t *log, const char *path, const char *bus_name, bool is_patient);

/* Write one line. A CAN FD frame that the bus has cut to 8 bytes is left out and counted, since its line would be that of
 * another frame. candump_close reports an error. */
void candump_write(candump_t *log, const dahl_can_frame_t *frame);

/* Write the buffered lines and close. Returns false if lines are missing: `missing` is their number, errno the reason. */
bool candump_close(candump_t *log);

#endif

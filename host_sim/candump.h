/* SPDX-License-Identifier: MIT */
/*
 * candump: a log of the bus in the form that candump -L writes and canplayer reads. Only whole lines are written, at any
 * moment and whatever ends the program; where a disk is full the piece of a line that still found room is cut off again.
 *
 * Nothing here delays a tick: a pipe whose reader is slow has CANDUMP_ROOM bytes of patience, 2 to 3 s of the pair of
 * frames at 1 kHz. After that, lines are left out whole and counted until there is room again. A patient log (virtual
 * time, where no tick can be missed) waits for its reader instead, CANDUMP_PATIENCE_MS at most.
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
    bool patient;
    int why;          /* errno of the write that failed; 0: none has */
    uint64_t missing; /* lines that could not be written */
    size_t torn;      /* bytes at the end of the file that are no whole line yet */
    size_t used;      /* bytes that wait */
    char bytes[CANDUMP_ROOM];
} candump_t;

/* A named pipe must find its reader within 2 s. False: errno says why; ENXIO: a pipe that nobody reads. */
bool candump_open(candump_t *log, const char *path, const char *bus_name, bool patient);

/* One line. What goes wrong is kept and told by candump_close. */
void candump_write(candump_t *log, const dahl_can_frame_t *frame);

/* Write what waits, and close. False: lines are missing; `missing` says how many, errno why. */
bool candump_close(candump_t *log);

#endif

/* SPDX-License-Identifier: MIT */
/* candump: a log of the bus in the form that candump -L writes and canplayer reads. */
#ifndef CANDUMP_H
#define CANDUMP_H

#include <stdbool.h>
#include <stdio.h>

#include "can_bus.h"

typedef struct {
    FILE *file;
    const char *bus_name;
} candump_t;

/* False: errno says why. */
bool candump_open(candump_t *log, const char *path, const char *bus_name);

/* One line. Errors are kept by the stream and told by candump_close. */
void candump_write(candump_t *log, const can_frame_t *frame);

/* Lines written so far become whole. False: something could not be written; errno says why. */
bool candump_close(candump_t *log);

#endif

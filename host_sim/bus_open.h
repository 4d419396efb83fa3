/* SPDX-License-Identifier: MIT */
/* bus_open: from --bus SPEC to an open bus. */
#ifndef BUS_OPEN_H
#define BUS_OPEN_H

#include <stdbool.h>
#include <stddef.h>

#include "dahl_can_bus.h"

#define BUS_NAME "vcan0" /* what python-can calls as channel of the served bus, and the name in logs */

typedef struct {
    dahl_can_bus_t *bus;
    const char *name; /* for the log */
} open_bus_t;

typedef struct {
    const char *spec;
    dahl_can_clock_t clock;
    bool patient;        /* wait for slow clients instead of dropping them (virtual time) */
    uint32_t bitrate;    /* of the loopback; 0: it takes no time */
    const uint32_t *ids; /* all that is listened to, where a kernel can filter; NULL: everything */
    size_t id_count;
} bus_wish_t;

/* Only one bus can be open in a process.
 * 0, or an exit code after one error line was printed: EXIT_BAD_INPUT for a bad spec, EXIT_RUNTIME for a bus not there. */
int bus_open(open_bus_t *opened, const bus_wish_t *wish);

#endif

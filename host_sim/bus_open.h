/* SPDX-License-Identifier: MIT */
/* bus_open: open the bus that --bus SPEC names. */
#ifndef BUS_OPEN_H
#define BUS_OPEN_H

#include <stdbool.h>
#include <stddef.h>

#include "dahl_can_bus.h"

#define BUS_NAME "vcan0" /* python-can's channel of the served bus, and the name in logs */

typedef struct {
    dahl_can_bus_t *bus;
    const char *name; /* for the log */
} open_bus_t;

typedef struct {
    const char *spec;
    dahl_can_clock_t clock;
    bool is_patient;     /* wait for slow clients instead of dropping them (virtual time) */
    const uint32_t *ids; /* ids to pass if the kernel can filter; NULL: all */
    size_t id_count;
} bus_config_t;

/* Only one bus can be open in a process. Returns 0, or prints one error line and returns an exit code:
 * EXIT_BAD_INPUT for a bad spec, EXIT_RUNTIME if the bus cannot be opened. */
int bus_open(open_bus_t *opened, const bus_config_t *config);

#endif

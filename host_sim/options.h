/* SPDX-License-Identifier: MIT */
/* options: the command line of dahl-loop. */
#ifndef OPTIONS_H
#define OPTIONS_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    const char *run_file;
    const char *bus;      /* "loopback" if absent */
    const char *log;      /* NULL: not written */
    const char *trace;    /* NULL: not written */
    const char *counters; /* NULL: not written; "-": stdout */
    bool run_encoder, run_node;
    bool is_virtual;
    bool until_idle;
    bool lockstep;
    double seconds; /* 0: no limit */
    uint64_t seed;
    uint64_t wait_clients;
    uint64_t nodes;
    uint64_t parent; /* end with this process; 0: run on */
} options_t;

/* Returns 0 to continue, 1 after --help or --version, -1 after one error line. */
int options_read(options_t *options, int argc, char **argv);

#endif

/* SPDX-License-Identifier: MIT */
/* options: the command line of dahl-loop. */
#ifndef OPTIONS_H
#define OPTIONS_H

#include <stdbool.h>
#include <stdint.h>

#define OPTIONS_SETS 32

typedef struct {
    const char *scene;
    const char *bus;      /* "loopback" when not given */
    const char *log;      /* NULL: none */
    const char *summary;  /* NULL: none; "-": stdout */
    const char *data;     /* directory for log files of scenes; NULL: that of the scene file */
    const char *log_file; /* instead of the scene's [motion] file; NULL: that one */
    const char *trace;    /* NULL: none */
    const char *sets[OPTIONS_SETS]; /* "section.key=value" */
    int set_count;
    bool run_encoder, run_node;
    bool is_virtual;
    bool until_idle;
    bool lockstep;
    double seconds; /* 0: no limit */
    uint64_t seed;
    uint32_t wait_clients;
    uint32_t nodes;
    uint32_t bitrate; /* 0: no load is computed, and loopback takes no time */
    uint32_t parent;  /* process whose end ends this one; 0: none */
} options_t;

/* 0: go on. 1: --help or --version was answered. -1: one error line was printed. */
int options_read(options_t *options, int argc, char **argv);

#endif

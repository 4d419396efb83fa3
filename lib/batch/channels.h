/* SPDX-License-Identifier: MIT */
/** A chunk of channels and a job for it, which all forms of channels.c share. */
#ifndef DAHL_BATCH_CHANNELS_H
#define DAHL_BATCH_CHANNELS_H

#include "throughput.h"

#define CHUNK 16  /* channels at a time */
#define BLOCK 128 /* ticks before d is carried into the state */

typedef struct {
    double a[CHUNK], Fc[CHUNK], w0[CHUNK], W0[CHUNK], d[CHUNK]; /* W0 = Fc w0 */
    double least_a;
    uint32_t small, tiny; /* least values of all channels */
    bool is_uniform;      /* all have one a and one Fc */
} chunk_t;

typedef struct {
    const dahl_throughput_params_t *params;
    dahl_state_t *states;
    const void *moves; /* int32_t or float; moves of the first channel of the chunk */
    float *F;
    size_t count, stride, n;
    bool by_counts;
    const void *wide_table; /* dahl_wide_table_t of channels_wide.h, or NULL */
    void *map_table;        /* dahl_map_table_t of channels_table.h */
} job_t;

/** Moves a chunk by a block of ticks. */
typedef void (*steps_t)(chunk_t *chunk, const job_t *job, size_t count, size_t first, size_t last);

#endif

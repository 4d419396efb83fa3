/* SPDX-License-Identifier: MIT */
/** Channels with AVX2: maps of counts from a table (map_table.h). The state is w, not d: the maps are those of Fc = 1. */
#ifndef DAHL_BATCH_CHANNELS_TABLE_H
#define DAHL_BATCH_CHANNELS_TABLE_H

#include "channels.h"
#include "map_table.h"

#ifdef DAHL_FOUR

/** Step 16 channels with the maps of a table. */
DAHL_FOUR void step_by_table(chunk_t *chunk, const job_t *job, const dahl_place_t *places, size_t first, size_t last)
{
    const dahl_map_table_t *table = job->table;
    const double *center = dahl_map_center(table);
    __m256d w[CHUNK / 4], Fc[CHUNK / 4];
    for (int v = 0; v < CHUNK / 4; v++) {
        w[v] = _mm256_loadu_pd(chunk->w0 + 4 * v);
        Fc[v] = _mm256_loadu_pd(chunk->Fc + 4 * v);
    }
    for (size_t t = first; t < last; t++, places += CHUNK) {
        DAHL_UNROLL_8
        for (int v = 0; v < CHUNK / 4; v++) {
            uint64_t four = dahl_map_load(places + 4 * v);
            dahl_four_maps_t maps = dahl_map_four(dahl_map_entry(center, four, 0), dahl_map_entry(center, four, 1),
                                                  dahl_map_entry(center, four, 2), dahl_map_entry(center, four, 3));
            w[v] = maps.e * w[v] + maps.c;
            _mm_storeu_ps(job->F + t * job->stride + 4 * v, _mm256_cvtpd_ps(Fc[v] * w[v]));
        }
    }
    for (int v = 0; v < CHUNK / 4; v++) {
        _mm256_storeu_pd(chunk->d + 4 * v, w[v] - _mm256_loadu_pd(chunk->w0 + 4 * v));
    }
}

#endif
#endif

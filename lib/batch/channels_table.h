/* SPDX-License-Identifier: MIT */
/** Channels with AVX2: maps of W by counts, from a table (map_table.h). */
#ifndef DAHL_BATCH_CHANNELS_TABLE_H
#define DAHL_BATCH_CHANNELS_TABLE_H

#include "channels.h"
#include "map_table.h"

#ifdef DAHL_FOUR

/** Convert rows of 16 moves to places. Return the largest |n|, or at least INT16_MAX. */
DAHL_FOUR int32_t places_of(dahl_place_t *places, const int32_t *moves, size_t rows, size_t stride)
{
    __m256i most = _mm256_setzero_si256();
    for (size_t row = 0; row < rows; row++) {
        (void)dahl_map_pack(places + CHUNK * row, moves + stride * row, &most);
    }
    return dahl_map_largest(most);
}

/** Step 16 channels with the maps of a table. */
DAHL_FOUR void step_by_table(chunk_t *chunk, const job_t *job, const dahl_place_t *places, size_t first, size_t last)
{
    const dahl_map_table_t *table = job->map_table;
    const double *center = dahl_map_center(table);
    __m256d W[CHUNK / 4];
    for (int v = 0; v < CHUNK / 4; v++) {
        W[v] = _mm256_loadu_pd(chunk->W0 + 4 * v);
    }
    for (size_t t = first; t < last; t++, places += CHUNK) {
        DAHL_UNROLL_8
        for (int v = 0; v < CHUNK / 4; v++) {
            uint64_t four = dahl_map_load(places + 4 * v);
            dahl_four_maps_t maps = dahl_map_four(dahl_map_entry(center, four, 0), dahl_map_entry(center, four, 1),
                                                  dahl_map_entry(center, four, 2), dahl_map_entry(center, four, 3));
            W[v] = maps.e * W[v] + maps.c;
            _mm_storeu_ps(job->F + t * job->stride + 4 * v, _mm256_cvtpd_ps(W[v]));
        }
    }
    for (int v = 0; v < CHUNK / 4; v++) { /* the motion of w */
        _mm256_storeu_pd(chunk->d + 4 * v, (W[v] - _mm256_loadu_pd(chunk->W0 + 4 * v)) / table->Fc);
    }
}

#endif
#endif

/* SPDX-License-Identifier: MIT */
/* Many channels side by side, bit for bit as single steps: the chains of several channels overlap in the processor. */
#include "batch.h"

#define CHUNK 16 /* channels whose state is kept at hand */

static void run_chunk(const dahl_plan_t *plans, dahl_state_t *states, size_t count, size_t stride, const int32_t *dcounts,
                      float *F, size_t n)
{
    double unit[CHUNK];
    dahl_state_t local[CHUNK];
    for (size_t c = 0; c < count; c++) {
        unit[c] = dahl_batch_unit(&plans[c]);
        local[c] = states[c];
    }
    for (size_t t = 0; t < n; t++, dcounts += stride, F += stride) {
        for (size_t c = 0; c < count; c++) {
            dahl_batch_move(&plans[c], &local[c], dcounts[c]);
            F[c] = dahl_batch_torque(&plans[c], local[c].w, unit[c]);
        }
    }
    for (size_t c = 0; c < count; c++) {
        states[c] = local[c];
    }
}

void dahl_batch_counts_channels(const dahl_plan_t *plans, dahl_state_t *states, size_t channels, const int32_t *dcounts,
                                float *F, size_t n)
{
    for (size_t first = 0; first < channels; first += CHUNK) {
        size_t count = channels - first < CHUNK ? channels - first : CHUNK;
        run_chunk(plans + first, states + first, count, channels, dcounts + first, F + first, n);
    }
}

void dahl_batch_channels(const dahl_plan_t *plans, dahl_state_t *states, size_t channels, const float *dtheta, float *F, size_t n)
{
    for (size_t i = 0; i < n * channels; i++) {
        F[i] = dahl_step(&plans[i % channels], &states[i % channels], dtheta[i]);
    }
}

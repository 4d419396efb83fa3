/* SPDX-License-Identifier: MIT */
/* Compare the bitwise batches with single steps, briefly for an emulated core. Prints the ticks that differ. */
#include <stdio.h>
#include <string.h>

#include "dahl_batch.h"
#include "../lib/bits.h"

enum { TICKS = 2000, CHANNELS = 3 };

static int32_t moves[TICKS * CHANNELS];
static float torques[TICKS * CHANNELS];
static float batch[TICKS];

static unsigned differing(const dahl_plan_t *plan, motion_fn next)
{
    const dahl_plan_t plans[CHANNELS] = {*plan, *plan, *plan};
    dahl_state_t states[CHANNELS] = {{0}, {0}, {0}}, single = {0}, whole = {0};
    motion_t motion = MOTION_START;
    unsigned wrong = 0;
    for (int t = 0; t < TICKS; t++) {
        int32_t move = next(&motion);
        moves[t] = move;
    }
    dahl_batch_counts(plan, &whole, moves, batch, TICKS);
    for (int i = TICKS * CHANNELS - 1; i >= 0; i--) {
        moves[i] = moves[i / CHANNELS];
    }
    dahl_batch_counts_channels(plans, states, CHANNELS, moves, torques, TICKS);
    for (int t = 0; t < TICKS; t++) {
        float F = dahl_step_counts(plan, &single, moves[t * CHANNELS]);
        wrong += memcmp(&F, &batch[t], sizeof F) != 0 || memcmp(&F, &torques[t * CHANNELS + 1], sizeof F) != 0;
    }
    return wrong + (single.w != whole.w) + (single.w != states[2].w);
}

int main(void)
{
    unsigned wrong = 0;
    for (unsigned run = 0; run < BITS_RUNS / 2; run++) {
        dahl_plan_t plan;
        wrong += dahl_prepare(&plan, &bits_params[run % BITS_PARAMS]) != DAHL_OK;
        wrong += differing(&plan, motions[run / BITS_PARAMS % MOTIONS].next);
    }
    printf("%u differ\n", wrong);
    return wrong != 0;
}

/* SPDX-License-Identifier: MIT */
/** Stage 1: the noise of the encoder at rest.
 *
 * The noise is the smaller of two measures. A creep does not raise the first one, the flicker about a slow mean. The ringing of
 * an axis on its bristles does not raise the second one, the second difference of the counts. */
#include "commission.h"

#define REST_S 0.5f
#define SKIPPED_PART 5  /* the first fifth of the rest settles */
#define WINDOW_TICKS 16 /* of the flicker */
#define CLASSES 64      /* count */

static uint32_t class_of(float counts)
{
    return counts < CLASSES - 1 ? (uint32_t)counts : CLASSES - 1;
}

/** Return the least class that covers `part` of the samples. */
static uint32_t quantile(const uint16_t *histogram, float part)
{
    uint32_t all = 0, sum = 0, k = 0;
    for (int i = 0; i < CLASSES; i++) {
        all += histogram[i];
    }
    for (; k < CLASSES - 1; k++) {
        sum += histogram[k];
        if ((float)sum >= part * (float)all) {
            break;
        }
    }
    return k;
}

static void count_jerk(dahl_commission_t *axis)
{
    int32_t *last = axis->work.rest.last;
    float jerk = dahl_absolute((float)axis->counts - 2 * (float)last[0] + (float)last[1]);
    axis->work.rest.jerk[class_of(jerk)]++;
}

static void count_flicker(dahl_commission_t *axis, uint32_t tick)
{
    float counts = (float)axis->counts - axis->work.rest.mean;
    uint32_t phase = tick % WINDOW_TICKS;
    axis->work.rest.low = phase == 0 ? counts : dahl_smaller(axis->work.rest.low, counts);
    axis->work.rest.high = phase == 0 ? counts : dahl_larger(axis->work.rest.high, counts);
    if (phase == WINDOW_TICKS - 1) {
        axis->work.rest.flicker[class_of(axis->work.rest.high - axis->work.rest.low + 0.3f)]++;
    }
}

static void finish_rest(dahl_commission_t *axis)
{
    uint32_t flicker = (quantile(axis->work.rest.flicker, 0.6f) + 1) / 2;
    uint32_t jerk = quantile(axis->work.rest.jerk, 0.9f) / 2;
    uint32_t noise = flicker < jerk ? flicker : jerk;
    axis->result.noise = (uint16_t)noise;
    axis->result.play = (uint16_t)(noise != 0 ? 2 * noise + 2 : 1);
    if (!axis->is_held) {
        dahl_track_from_here(axis);
    }
    dahl_enter(axis, DAHL_COMMISSION_SWEEPS);
}

void dahl_rest_tick(dahl_commission_t *axis)
{
    const uint32_t ticks = dahl_ticks(axis, REST_S), skipped = ticks / SKIPPED_PART;
    if (!axis->is_held && dahl_absolute(axis->theta) > FALL_RAD) {
        dahl_track_from_here(axis);
        dahl_enter(axis, DAHL_COMMISSION_REST);
        axis->is_held = 1;
        return;
    }
    if (axis->stage_ticks == 1) {
        axis->work.rest.mean = (float)axis->counts;
    }
    axis->work.rest.mean += ((float)axis->counts - axis->work.rest.mean) * (1.0f / WINDOW_TICKS);
    if (axis->stage_ticks > skipped) {
        count_jerk(axis);
        count_flicker(axis, axis->stage_ticks - skipped - 1);
    }
    axis->work.rest.last[1] = axis->work.rest.last[0];
    axis->work.rest.last[0] = axis->counts;
    if (axis->stage_ticks >= ticks) {
        finish_rest(axis);
    }
}

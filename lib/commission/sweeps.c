/* SPDX-License-Identifier: MIT */
/** Stage 2: strokes to and fro at three speeds. The torque of each stroke is averaged in bins of angle.
 *
 * Half the difference of the directions is friction, half the sum is load. The slope of friction over speed is viscous
 * friction. Two passes at each speed show if the friction repeats. */
#include "commission.h"

#define SPEEDS DAHL_COMMISSION_SPEEDS
#define STROKES 4                /* at each speed: down, up, down, up */
#define ACCELERATION 60.0f       /* rad/s2 */
#define AXIS_SETTLE_S 0.04f      /* of a stroke before its first sample */
#define MIN_SAMPLES 4            /* of a bin */
#define NARROW_BIN_RAD 0.035f    /* a stroke needs up to this to settle */
#define MIN_BINS 4               /* of a speed */
#define MAX_SHIFT 0.2f           /* of the friction between two passes, over Fc */
#define MAX_SCATTER 0.25f        /* of the bins between two passes, over Fc */
#define TORQUE_MARGIN 4.0f       /* of the limit over friction and load */
#define LEVEL_ERROR 0.006f       /* of Fc: smallest error of a speed */
#define COUNT_WAITS 4.0f         /* wait of the watch on the encoder, over the time of the first count */
#define MAX_ACCELERATION 225.0f  /* rad/s2 that the limit must allow */
#define MAX_BACKWARD_SHARE 0.05f /* of the ticks of a stroke: an axis that shakes moves backward, and friction cancels */

/** [rad/s] Speeds, and those after the loop shook the axis at the slowest one. */
static const float sweep_speeds[2][SPEEDS] = {{0.6f, 1.2f, DAHL_COMMISSION_SPEED_MAX},
                                              {1.2f, 1.8f, DAHL_COMMISSION_SPEED_MAX}};

/** Steps of the evaluation of a speed, after its bins. */
enum { FIND_LEVEL = BINS, LOWER_LIMIT, CHECK_REPEAT, NEXT_SPEED, FIT_LINE, FIND_VISCOUS };

static int bin_of(const dahl_commission_t *axis, float angle)
{
    float x = (angle + axis->config.travel) * (0.5f * BINS) / axis->config.travel;
    return x < 0 ? 0 : x >= BINS ? BINS - 1 : (int)x;
}

/** Interpolate linearly between the middles of the bins. */
float dahl_commission_load(const dahl_commission_t *axis, float angle)
{
    const float *load = axis->result.load;
    float x = (angle + axis->config.travel) * (0.5f * BINS) / axis->config.travel - 0.5f;
    if (!(x > 0)) {
        return load[0];
    }
    if (x >= BINS - 1) {
        return load[BINS - 1];
    }
    int bin = (int)x;
    return load[bin] + (x - (float)bin) * (load[bin + 1] - load[bin]);
}

static void add_to_bin(dahl_commission_t *axis)
{
    uint32_t first = axis->stroke.ramp_ticks + dahl_ticks(axis, AXIS_SETTLE_S);
    uint32_t last = axis->stroke.ramp_ticks + axis->stroke.cruise_ticks;
    if (axis->work.sweeps.stroke == 0 || axis->stroke.tick <= first || axis->stroke.tick > last) {
        return;
    }
    int kind = (axis->command.speed > 0 ? 1 : 0) + (axis->work.sweeps.stroke > 2 ? 2 : 0);
    int bin = bin_of(axis, axis->theta);
    if (axis->command.speed * axis->speed < 0) {
        axis->work.sweeps.backward_ticks++;
    }
    axis->work.sweeps.sum[kind][bin] += axis->torque;
    axis->work.sweeps.samples[kind][bin]++;
}

/** Write the mean torques of the four strokes. Return 0 if the bin has too few samples. */
static int means_of_bin(const dahl_commission_t *axis, int bin, float mean[STROKES])
{
    for (int kind = 0; kind < STROKES; kind++) {
        uint16_t samples = axis->work.sweeps.samples[kind][bin];
        if (samples < MIN_SAMPLES) {
            return 0;
        }
        mean[kind] = axis->work.sweeps.sum[kind][bin] / (float)samples;
    }
    return 1;
}

/** Add the friction of a bin to the sums over this speed. */
static void add_friction(dahl_commission_t *axis, int bin, float first, float second)
{
    const float friction = (first + second) / 2, change = second - first;
    if (axis->work.sweeps.speed == 0) {
        axis->table.friction[bin] = friction;
        axis->table.least = axis->work.sweeps.bins == 0 ? friction : axis->table.least;
    }
    axis->work.sweeps.friction += friction;
    axis->work.sweeps.reference += axis->table.friction[bin];
    axis->work.sweeps.change += change;
    axis->work.sweeps.square += change * change;
    axis->work.sweeps.bins++;
    axis->table.least = dahl_smaller(axis->table.least, friction);
    if (axis->work.sweeps.speed < SPEEDS - 1) { /* the fastest speed is viscous */
        axis->table.most = dahl_larger(axis->table.most, friction);
    }
}

/** Evaluate a bin and clear it for the next speed. */
static void use_bin(dahl_commission_t *axis, int bin)
{
    float mean[STROKES], *load = &axis->result.load[bin];
    if (means_of_bin(axis, bin, mean)) {
        add_friction(axis, bin, (mean[1] - mean[0]) / 2, (mean[3] - mean[2]) / 2);
        *load += ((mean[0] + mean[1] + mean[2] + mean[3]) / 4 - *load) / (float)(axis->work.sweeps.speed + 1);
    }
    for (int kind = 0; kind < STROKES; kind++) {
        axis->work.sweeps.sum[kind][bin] = 0;
        axis->work.sweeps.samples[kind][bin] = 0;
    }
}

static int is_empty(const dahl_commission_t *axis, int bin)
{
    return !(dahl_absolute(axis->table.friction[bin]) > 0);
}

/** Return 1 if a bin that a stroke must reach is empty: an end stop. */
static int has_gap(const dahl_commission_t *axis)
{
    const int is_narrow = axis->config.travel < NARROW_BIN_RAD * 0.5f * BINS || axis->is_fast;
    const int ends = is_narrow + 4 * axis->is_soft;
    int gaps = 0;
    for (int bin = ends; bin < BINS - ends; bin++) {
        gaps += is_empty(axis, bin);
    }
    return gaps > 0;
}

/** Fill an empty bin with the values of its neighbour. */
static void fill_bin(dahl_commission_t *axis, int bin, int from)
{
    if (is_empty(axis, bin)) {
        axis->table.friction[bin] = axis->table.friction[from];
        axis->result.load[bin] = axis->result.load[from];
    }
}

static void fill_ends(dahl_commission_t *axis)
{
    for (int k = 1; k < BINS; k++) {
        fill_bin(axis, k, k - 1);
    }
    for (int k = BINS - 1; k > 0; k--) {
        fill_bin(axis, k - 1, k);
    }
}

/** Lower the torque limit, because the friction is known now. */
static void lower_torque_limit(dahl_commission_t *axis)
{
    float most = 0;
    for (int bin = 0; bin < BINS; bin++) {
        most = dahl_larger(most, axis->table.friction[bin] + dahl_absolute(axis->result.load[bin]));
    }
    most = TORQUE_MARGIN * most + MAX_ACCELERATION * axis->config.inertia;
    axis->command.torque_limit = dahl_smaller(axis->config.torque_limit, most);
}

/** Compare both passes. Refuse if the friction does not repeat. */
static void check_repeat(dahl_commission_t *axis)
{
    const float bins = (float)axis->work.sweeps.bins, level = axis->table.level[axis->work.sweeps.speed];
    float shift = axis->work.sweeps.change / bins;
    float scatter = dahl_root(dahl_larger(0, axis->work.sweeps.square / bins - shift * shift)) / 2;
    axis->table.scatter = dahl_larger(axis->table.scatter, scatter);
    axis->table.noise[axis->work.sweeps.speed] = dahl_absolute(shift) / 2 + 2 * scatter / dahl_root(bins);
    if (!(level > 0 && dahl_absolute(shift) <= MAX_SHIFT * level && scatter <= MAX_SCATTER * level)) {
        dahl_refuse(axis, DAHL_COMMISSION_VARIES);
    }
}

/** Fit a straight line to friction over speed. */
static void fit_line(dahl_commission_t *axis)
{
    const float *speed = sweep_speeds[axis->is_fast];
    float n = 0, v = 0, f = 0, vv = 0, vf = 0;
    for (int k = 0; k < SPEEDS && axis->table.level[k] > 0; k++) {
        n += 1;
        v += speed[k];
        f += axis->table.level[k];
        vv += speed[k] * speed[k];
        vf += speed[k] * axis->table.level[k];
    }
    const float slope = n > 1 ? (n * vf - v * f) / (n * vv - v * v) : 0;
    axis->work.sweeps.slope = slope;
    axis->work.sweeps.intercept = (f - slope * v) / n;
    axis->result.Fc.best = (f - dahl_larger(0, slope) * v) / n;
}

/** Write the slope with its interval, which covers scatter and lack of fit. */
static void find_viscous(dahl_commission_t *axis)
{
    const float *speed = sweep_speeds[axis->is_fast], slope = axis->work.sweeps.slope;
    float error = 0, range = 0;
    for (int k = 0; k < SPEEDS && axis->table.level[k] > 0; k++) {
        float gap = axis->table.level[k] - axis->work.sweeps.intercept - slope * speed[k];
        error = dahl_larger(error, dahl_absolute(gap) + axis->table.noise[k]);
        range = speed[k] - speed[0];
    }
    error += LEVEL_ERROR * axis->result.Fc.best;
    error = range > 0 ? 2 * error / range : axis->result.Fc.best / speed[0];
    axis->result.viscous.best = dahl_larger(0, slope);
    axis->result.viscous.least = dahl_larger(0, slope - error);
    axis->result.viscous.most = dahl_larger(0, slope + error);
}

/** Set the time that some counts take after a stop, while the bristles push the axis back: the watch on the encoder waits. */
static void set_count_time(dahl_commission_t *axis)
{
    float acceleration = axis->result.Fc.best / axis->config.inertia;
    axis->watch.count_ticks = dahl_ticks(axis, COUNT_WAITS * dahl_root(2 * axis->config.theta_per_count / acceleration));
}

/** Find the level of one speed. If the loop does not reach the speed, the line has fewer points. */
static void find_level(dahl_commission_t *axis)
{
    const int speed = axis->work.sweeps.speed;
    const float bins = (float)axis->work.sweeps.bins;
    if (speed == 0 && has_gap(axis)) {
        dahl_refuse(axis, DAHL_COMMISSION_NO_DATA);
    } else if (axis->work.sweeps.bins < MIN_BINS) {
        axis->work.sweeps.bin = FIT_LINE;
    } else if (speed == 0) {
        fill_ends(axis);
        axis->table.level[0] = axis->work.sweeps.friction / bins;
    } else {
        axis->table.level[speed] = axis->table.level[0] + (axis->work.sweeps.friction - axis->work.sweeps.reference) / bins;
    }
}

/** Start the next speed. Return 0 after the last one. */
static int next_speed(dahl_commission_t *axis)
{
    uint8_t speed = (uint8_t)(axis->work.sweeps.speed + 1);
    if (speed == SPEEDS) {
        return 0;
    }
    axis->work.sweeps.friction = axis->work.sweeps.reference = 0;
    axis->work.sweeps.change = axis->work.sweeps.square = 0;
    axis->work.sweeps.bins = axis->work.sweeps.bin = 0;
    axis->work.sweeps.speed = speed;
    axis->work.sweeps.stroke = 0;
    return 1;
}

/** After the strokes of a speed, evaluate one bin or one step in each tick. Return 1 if the next speed starts. */
static int evaluate_tick(dahl_commission_t *axis)
{
    const uint8_t step = axis->work.sweeps.bin++;
    if (step < BINS) {
        use_bin(axis, step);
    } else if (step == FIND_LEVEL) {
        find_level(axis);
    } else if (step == LOWER_LIMIT) {
        lower_torque_limit(axis);
    } else if (step == CHECK_REPEAT) {
        check_repeat(axis);
    } else if (step == NEXT_SPEED) {
        return next_speed(axis);
    } else if (step == FIT_LINE) {
        fit_line(axis);
    } else if (step == FIND_VISCOUS) {
        find_viscous(axis);
    } else {
        set_count_time(axis);
        dahl_enter(axis, DAHL_COMMISSION_CYCLE);
        dahl_return_to_middle(axis);
    }
    return 0;
}

/** Return 1 at the end of a stroke. */
static int sweep_tick(dahl_commission_t *axis)
{
    add_to_bin(axis);
    return dahl_stroke_tick(axis);
}

/** Start the next stroke of a speed. */
static void next_sweep(dahl_commission_t *axis)
{
    float end = axis->work.sweeps.stroke & 1 ? -axis->config.travel : axis->config.travel;
    axis->work.sweeps.backward_ticks = 0;
    dahl_stroke_to(axis, end, sweep_speeds[axis->is_fast][axis->work.sweeps.speed], ACCELERATION);
}

/** Sweep again at higher speeds, because the loop shakes the axis. Refuse if it still does. */
static void sweep_faster(dahl_commission_t *axis)
{
    if (axis->is_fast || axis->work.sweeps.speed > 0) {
        dahl_refuse(axis, DAHL_COMMISSION_VARIES);
        return;
    }
    axis->is_fast = 1;
    dahl_enter(axis, DAHL_COMMISSION_SWEEPS);
    next_sweep(axis);
}

void dahl_sweeps_tick(dahl_commission_t *axis)
{
    if (axis->stage_ticks == 1) {
        next_sweep(axis);
    }
    const int is_end = axis->work.sweeps.stroke > STROKES ? evaluate_tick(axis) : sweep_tick(axis);
    if (!is_end) {
        return;
    }
    if ((float)axis->work.sweeps.backward_ticks > MAX_BACKWARD_SHARE * (float)axis->stroke.cruise_ticks) {
        sweep_faster(axis);
        return;
    }
    if (++axis->work.sweeps.stroke <= STROKES) {
        next_sweep(axis);
    }
}

/* SPDX-License-Identifier: MIT */
/** Stage 4: a torque ramp until the axis slides, in both directions, without the loop. With the stiffness of the cycle, the
 * breakaway torque is the presliding length. */
#include "commission.h"

#define RATE 0.5f            /* Fc/s: a faster ramp hides the breakaway of a slow Stribeck curve */
#define FAST_RATE 8.0f       /* Fc/s below FAST_SHARE */
#define FAST_SHARE 0.8f      /* of Fc */
#define RELAX_S 0.1f         /* the bristles relax before the ramp */
#define SLIDING_RAD 0.06f
#define SLIDING_SPEED 0.5f   /* rad/s */
#define WRONG_WAY_RAD 0.05f
#define MAX_BREAKAWAY 1.9f   /* of the largest Fc */
#define UNSEEN_BREAKAWAY 1.36f /* breakaway over that of a ramp: slow Stribeck */
#define STEEPER 1.32f        /* steepest stiffness over that of the cycle: slip elements */
#define HIDDEN_LOAD 0.6f     /* rad: mean of a load over its slope, that unequal friction may cancel */
#define LEAST_SHARE 0.985f   /* of the least friction of a bin: the ripple within it */
#define TURN_LENGTHS 6.0f    /* slip elements reach Fc at this multiple of the presliding length after a turn */
#define MIN_CYCLE_COUNTS 1.5f

/** Return atanh(ratio)/ratio within 0.5 %: the mean slope of a Dahl loop up to `ratio` of Fc is 1/this of sigma0. */
static float loop_slope(float ratio)
{
    const float x = dahl_smaller(0.85f, ratio), square = x * x;
    return (945.0f - square * (735.0f - 64.0f * square)) / (945.0f - square * (1050.0f - 225.0f * square));
}

/** Return the presliding stiffness, if the cycle moved the axis by `travel` and it breaks away at `breakaway` of Fc. */
static float stiffness(const dahl_commission_t *axis, float travel, float breakaway)
{
    float torque = axis->cycle_torque;
    return 2 * torque / travel * loop_slope(torque / (breakaway * axis->middle_Fc));
}

/** Return the largest part of the load that may be unequal friction: its mean and its slope over the angle. Cogging cancels
 * in both. */
static float unequal_friction(const dahl_commission_t *axis)
{
    float mean = 0, slope = 0, weight = 0;
    for (int bin = 0; bin < BINS; bin++) {
        float x = (float)(2 * bin + 1) / DAHL_COMMISSION_BINS - 1;
        mean += axis->result.load[bin] / DAHL_COMMISSION_BINS;
        slope += axis->result.load[bin] * x;
        weight += x * x;
    }
    float most = dahl_absolute(mean) + HIDDEN_LOAD * dahl_absolute(slope / weight) / axis->config.travel;
    return dahl_smaller(most, UNEQUAL_SHARE * axis->result.Fc.best);
}

/** Correct a bin near an end, where the friction has not yet grown to Fc after the turn: it is between that of the bin and that
 * of the next bin `inner`. The torque of the stroke that arrives at the end stays. Return the change. */
static float correct_bin(dahl_commission_t *axis, int bin, int inner)
{
    float *friction = axis->table.friction, more = dahl_larger(0, (friction[inner] - friction[bin]) / 2);
    friction[bin] += more;
    axis->result.load[bin] += bin < inner ? more : -more;
    return more;
}

static float least_friction(const dahl_commission_t *axis)
{
    float least = axis->table.friction[0];
    for (int bin = 1; bin < BINS; bin++) {
        least = dahl_smaller(least, axis->table.friction[bin]);
    }
    return least;
}

/** Correct the ends over TURN_LENGTHS of the presliding. Return the largest change. */
static float correct_ends(dahl_commission_t *axis)
{
    const float least = least_friction(axis), width = 2 * axis->config.travel / BINS;
    const float length = axis->result.Fc.best * axis->cycle_travel / (2 * axis->cycle_torque);
    float most = 0, sum = 0;
    for (int k = BINS / 2 - 2; k >= 0; k--) {
        if (((float)k + 0.5f) * width < TURN_LENGTHS * length) {
            float low = correct_bin(axis, k, k + 1), high = correct_bin(axis, BINS - 1 - k, BINS - 2 - k);
            most = dahl_larger(most, dahl_larger(low, high));
            sum += low + high;
        }
    }
    axis->table.least += least_friction(axis) - least;
    axis->result.Fc.best += sum / BINS;
    return most;
}

static void find_friction(dahl_commission_t *axis)
{
    dahl_commission_result_t *result = &axis->result;
    const float change = axis->work.breakaway.change;
    float unequal = unequal_friction(axis), viscous = 0.6f * result->viscous.best;
    result->Fc.least = LEAST_SHARE * (axis->table.least - viscous) - unequal - axis->table.scatter;
    result->Fc.most = result->breakaway * UNSEEN_BREAKAWAY * (axis->table.most + unequal);
    result->load_error = unequal + axis->table.scatter + change + 0.03f * result->Fc.best;
    for (int bin = 0; bin < BINS; bin++) {
        result->load_most = dahl_larger(result->load_most, dahl_absolute(result->load[bin]) + result->load_error);
    }
}

static void find_length(dahl_commission_t *axis)
{
    dahl_commission_result_t *result = &axis->result;
    const float breakaway = result->breakaway, unseen = breakaway * UNSEEN_BREAKAWAY;
    const float rounding = (float)(result->noise != 0 ? 2 : 1) * axis->config.theta_per_count;
    const float travel = axis->cycle_travel, least_travel = dahl_larger(travel - rounding, travel / 3);
    result->sigma0.best = stiffness(axis, travel, breakaway);
    result->sigma0.least = stiffness(axis, travel + rounding, unseen);
    result->sigma0.most = STEEPER * stiffness(axis, least_travel, 1);
    result->length.best = breakaway * result->Fc.best / result->sigma0.best;
    result->length.least = result->Fc.least / result->sigma0.most;
    result->length.most = result->Fc.most / result->sigma0.least;
}

static void find_breakaway(dahl_commission_t *axis)
{
    float both = 0.5f * (axis->break_torque[0] + axis->break_torque[1]);
    axis->result.breakaway = dahl_larger(1, both / axis->middle_Fc);
    axis->work.breakaway.change = correct_ends(axis);
}

static void finish_breakaway(dahl_commission_t *axis)
{
    if (!(axis->result.Fc.least > 0.1f * axis->result.Fc.best)) {
        dahl_refuse(axis, DAHL_COMMISSION_VARIES);
        return;
    }
    dahl_enter(axis, DAHL_COMMISSION_INERTIA);
}

/** The way back has started: evaluate one step in each tick. */
static void evaluate_breakaway(dahl_commission_t *axis)
{
    (void)dahl_stroke_tick(axis);
    const uint8_t evaluated = axis->work.breakaway.evaluated++;
    if (evaluated == 0) {
        find_breakaway(axis);
    } else if (evaluated == 1) {
        find_friction(axis);
    } else if (evaluated == 2) {
        find_length(axis);
    } else {
        finish_breakaway(axis);
    }
}

/** Raise the torque. Return the torque over the load in the direction of the ramp. */
static float raise_torque(dahl_commission_t *axis, float direction)
{
    float over_load = direction * (axis->command.torque - dahl_commission_load(axis, 0));
    float rate = (over_load < FAST_SHARE * axis->middle_Fc ? FAST_RATE : RATE) * axis->middle_Fc;
    axis->command.torque += direction * rate * axis->config.period;
    return over_load;
}

static void ramp_tick(dahl_commission_t *axis)
{
    const float direction = axis->pass == 0 ? 1.0f : -1.0f;
    float torque = raise_torque(axis, direction), moved = direction * (axis->theta - axis->work.breakaway.start);
    axis->work.breakaway.peak = dahl_larger(axis->work.breakaway.peak, torque);
    if (moved > SLIDING_RAD || direction * axis->speed > SLIDING_SPEED) {
        axis->break_torque[axis->pass++] = axis->work.breakaway.peak;
        dahl_return_to_middle(axis);
        if (axis->cycle_travel < MIN_CYCLE_COUNTS * axis->config.theta_per_count) {
            dahl_refuse(axis, DAHL_COMMISSION_COARSE);
        }
    } else if (moved < -WRONG_WAY_RAD) {
        dahl_refuse(axis, DAHL_COMMISSION_DISTURBED);
    } else if (torque > MAX_BREAKAWAY * axis->table.most) {
        dahl_refuse(axis, DAHL_COMMISSION_COARSE);
    }
}

void dahl_breakaway_tick(dahl_commission_t *axis)
{
    if (axis->pass == 2) {
        evaluate_breakaway(axis);
    } else if (axis->step == 0) {
        if (dahl_wait_in_middle(axis, 0.1f)) {
            axis->work.breakaway.peak = 0;
            dahl_next_step(axis);
        }
    } else if (axis->step == 1) {
        axis->work.breakaway.start = axis->theta;
        if (++axis->step_ticks > dahl_ticks(axis, RELAX_S)) {
            dahl_next_step(axis);
        }
    } else {
        ramp_tick(axis);
    }
}

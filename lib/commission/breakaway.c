/* SPDX-License-Identifier: MIT */
/** Stage 4: a torque ramp in each direction until the axis slides, without the loop.
 *
 * The breakaway torque over the stiffness of the cycle is the presliding length. */
#include "commission.h"

#define RAMP_RATE 0.5f            /* Fc/s: a faster ramp hides the breakaway of a slow Stribeck curve */
#define FAST_RAMP_RATE 8.0f       /* Fc/s below FAST_SHARE */
#define FAST_SHARE 0.8f           /* of Fc */
#define RELAX_S 0.1f              /* the bristles relax before the ramp */
#define SLIDING_RAD 0.06f
#define SLIDING_SPEED 0.5f        /* rad/s */
#define WRONG_WAY_RAD 0.05f
#define MAX_RAMP_TORQUE 1.9f      /* of the largest friction of a bin */
#define BREAKAWAY_OVER_RAMP 1.36f /* largest breakaway torque over that of the ramp: a slow Stribeck curve */
#define STEEPEST_OVER_CYCLE 1.32f /* largest stiffness over that of the cycle: slip elements */
#define HIDDEN_LOAD_RAD 0.8f      /* mean of a load over its slope, if unequal friction cancels the load */
#define RIPPLE_SHARE 0.985f       /* friction at the ripple within a bin, over that of the bin */
#define TURN_LENGTHS 6.0f         /* presliding lengths after a turn, in which slip elements grow to Fc */
#define MIN_CYCLE_COUNTS 1.5f
#define ROUNDING_COUNTS 0.75f        /* error of the travel, a difference of two means; worst of 450 axes: 0.52 */

/** Return atanh(ratio)/ratio within 0.5 %: sigma0 over the mean slope of a Dahl loop up to `ratio` of Fc. */
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
 * in both of them. */
static float unequal_friction(const dahl_commission_t *axis)
{
    const float share = 1.0f / BINS, weight = (float)(BINS * BINS - 1) / (3 * BINS); /* sum of x^2 over the bins */
    float mean = 0, slope = 0, x = share - 1;
    for (int bin = 0; bin < BINS; bin++) {
        mean += axis->result.load[bin];
        slope += axis->result.load[bin] * x;
        x += 2 * share;
    }
    float most = dahl_absolute(mean) * share + HIDDEN_LOAD_RAD / weight * dahl_absolute(slope) / axis->config.travel;
    return dahl_smaller(most, UNEQUAL_SHARE * axis->result.Fc.best);
}

/** Correct a bin near an end and return the change. There, friction has not yet grown to Fc after the turn. The true value is
 * between that of the bin and that of the next bin, `inner`. The stroke that arrives at the end keeps its torque. */
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

/** Correct the bins within TURN_LENGTHS of both ends. Return the largest change. */
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
    result->Fc.least = RIPPLE_SHARE * (axis->table.least - viscous) - unequal - axis->table.scatter;
    result->Fc.most = result->breakaway * BREAKAWAY_OVER_RAMP * (axis->table.most + unequal);
    result->load_error = unequal + axis->table.scatter + change + 0.03f * result->Fc.best;
}

static void find_most_load(dahl_commission_t *axis)
{
    dahl_commission_result_t *result = &axis->result;
    for (int bin = 0; bin < BINS; bin++) {
        result->load_most = dahl_larger(result->load_most, dahl_absolute(result->load[bin]) + result->load_error);
    }
}

/** Write one of the three stiffnesses. */
static void find_stiffness(dahl_commission_t *axis, int which)
{
    dahl_commission_result_t *result = &axis->result;
    const float rounding = ROUNDING_COUNTS * axis->config.theta_per_count, travel = axis->cycle_travel;
    if (which == 0) {
        result->sigma0.best = stiffness(axis, travel, result->breakaway);
    } else if (which == 1) {
        result->sigma0.least = stiffness(axis, travel + rounding, result->breakaway * BREAKAWAY_OVER_RAMP);
    } else {
        result->sigma0.most = STEEPEST_OVER_CYCLE * stiffness(axis, dahl_larger(travel - rounding, travel / 3), 1);
    }
}

static void find_length(dahl_commission_t *axis)
{
    dahl_commission_result_t *result = &axis->result;
    result->length.best = result->breakaway * result->Fc.best / result->sigma0.best;
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

/** Evaluate one step in each tick, while the axis returns to the middle. */
static void evaluate_breakaway(dahl_commission_t *axis)
{
    (void)dahl_stroke_tick(axis);
    const uint8_t evaluated = axis->work.breakaway.evaluated++;
    if (evaluated == 0) {
        find_breakaway(axis);
    } else if (evaluated == 1) {
        find_friction(axis);
    } else if (evaluated == 2) {
        find_most_load(axis);
    } else if (evaluated < 6) {
        find_stiffness(axis, evaluated - 3);
    } else if (evaluated == 6) {
        find_length(axis);
    } else {
        finish_breakaway(axis);
    }
}

/** Raise the torque. Return the torque less the load, in the direction of the ramp. */
static float raise_torque(dahl_commission_t *axis, float direction)
{
    float over_load = direction * (axis->command.torque - dahl_commission_load(axis, 0));
    float rate = (over_load < FAST_SHARE * axis->middle_Fc ? FAST_RAMP_RATE : RAMP_RATE) * axis->middle_Fc;
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
    } else if (torque > MAX_RAMP_TORQUE * axis->table.most) {
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

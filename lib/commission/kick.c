/* SPDX-License-Identifier: MIT */
/** Stage 6: short pushes on an axis whose compensator runs on the bounds that were found, and whose load is fed forward.
 *
 * The axis must come to rest after each push. If it swings, length_long grows. After MAX_FAILS swings, the result is the last
 * gain that passed. If the axis creeps, because the load differs from its table, the gain falls. */
#include "../arith/compiler.h"
#include "commission.h"

#define GAINS 3
#define MAX_FAILS 5
#define LENGTH_FACTOR 1.6f      /* of length_long after a swing */
#define FADE_S 0.06f            /* wait for the compensator, which fades in within 0.05 s */
#define PUSH_S 0.05f            /* longest push */
#define PUSH_RAD 0.1f
#define MAX_SPEED 2.5f          /* rad/s */
#define WATCH_S 0.2f            /* of a window */
#define CREEP_WINDOWS 3         /* of creep after a push, until the gain falls */
#define FIRST_WINDOWS 2         /* the same at the highest gain, which leaves the least friction */
#define SWING_WINDOWS 10
#define MAX_WINDOWS 20
#define SETTLING_SHARE 0.9f     /* range of a window over that of two windows before */
#define MAX_EXCURSION_RAD 0.25f /* beyond the travel */
#define REST_SPEED 0.02f        /* rad/s: drift and ring on the bristles together, as dahl_compensator.h states it */
#define PEAK_OVER_CREEP 2.5f    /* a creep rings until it almost stops, and is faster at other angles */

enum { WRITE_PARAMS, PREPARE_ELEMENT, PREPARE_COMPENSATOR, FADE_IN, PUSH, SETTLE };

static const float gains[GAINS] = {0.5f, 0.9f, COMMISSION_MAX_GAIN};

static void finish_kicks(dahl_commission_t *axis)
{
    axis->result.seconds = (float)axis->ticks * axis->config.period;
    axis->command.mode = DAHL_COMMISSION_OFF;
    axis->command.torque = 0;
    dahl_enter(axis, DAHL_COMMISSION_DONE);
}

/** Write the parameters with the next gain. */
static void write_params(dahl_commission_t *axis)
{
    const float passed = axis->result.gain;
    axis->result.gain = gains[axis->work.kick.gain];
    dahl_write_params(axis, &axis->work.kick.params, 0);
    axis->result.gain = passed;
    axis->work.kick.bristle = (dahl_state_t){0};
    axis->work.kick.compensator = (dahl_compensator_t){0};
}

/** Write the parameters, prepare the element, then the compensator, each in one tick, because they take long. */
static void prepare_tick(dahl_commission_t *axis)
{
    const dahl_compensator_params_t *params = &axis->work.kick.params;
    if (axis->work.kick.phase == WRITE_PARAMS) {
        write_params(axis);
        axis->work.kick.phase = PREPARE_ELEMENT;
        return;
    }
    if (axis->work.kick.phase == PREPARE_ELEMENT) {
        if (dahl_prepare(&axis->work.kick.friction, &params->friction) != DAHL_OK) {
            dahl_refuse(axis, DAHL_COMMISSION_COARSE);
        }
        axis->work.kick.phase = PREPARE_COMPENSATOR;
        return;
    }
    dahl_compensator_err_t code = dahl_compensator_prepare(&axis->work.kick.plan, params);
    if (code != DAHL_COMPENSATOR_OK) {
        dahl_refuse(axis, code == DAHL_COMPENSATOR_INERTIA ? DAHL_COMMISSION_LIGHT : DAHL_COMMISSION_COARSE);
    }
    axis->work.kick.phase = FADE_IN;
    axis->step_ticks = 0;
}

/** Start a kick: two with a push of 1 Fc, one each way, then two of 2 Fc. A push ends at a speed from which the remaining
 * friction stops the axis within half of the travel. */
static void start_kick(dahl_commission_t *axis)
{
    const dahl_commission_result_t *result = &axis->result;
    uint8_t kick = axis->work.kick.kick;
    float left = 1 - gains[axis->work.kick.gain] * result->Fc.least / result->Fc.best;
    float braking = left * result->Fc.best / result->inertia.best;
    axis->work.kick.speed = dahl_smaller(MAX_SPEED, dahl_root(braking * axis->config.travel));
    axis->work.kick.push = (kick & 1 ? -1.0f : 1.0f) * (kick < 2 ? 1.0f : 2.0f) * result->Fc.best;
    axis->work.kick.noise = (float)(2 * result->noise + 1) * axis->config.theta_per_count;
    axis->work.kick.ring = dahl_root(result->sigma0.best / result->inertia.best);
    axis->work.kick.start = axis->theta;
    axis->work.kick.phase = WRITE_PARAMS;
    axis->work.kick.windows = 0;
    dahl_next_step(axis);
}

/** Return the torque of the compensator. */
static float compensate(dahl_commission_t *axis, int32_t dcounts)
{
    int32_t move = dahl_compensator_move(&axis->work.kick.plan, &axis->work.kick.compensator, dcounts, 1);
    int32_t ratio = dahl_step_counts_q30(&axis->work.kick.friction, &axis->work.kick.bristle, move);
    ratio = dahl_compensator_torque(&axis->work.kick.plan, &axis->work.kick.compensator, ratio);
    return (float)ratio * 0x1p-30f * axis->result.Fc.least;
}

/** Return 1 while the push lasts. */
static int is_pushing(const dahl_commission_t *axis)
{
    float direction = axis->work.kick.push < 0 ? -1.0f : 1.0f;
    return direction * axis->speed < axis->work.kick.speed
           && direction * (axis->theta - axis->work.kick.start) < PUSH_RAD && axis->step_ticks < dahl_ticks(axis, PUSH_S);
}

static void start_window(dahl_commission_t *axis)
{
    axis->work.kick.low = axis->work.kick.high = axis->work.kick.first = axis->theta;
}

/** Motion of the axis in a window. */
typedef enum { NOT_ENDED, RESTS, SETTLES, CREEPS, SWINGS } window_t;

static DAHL_COLD window_t classify(const dahl_commission_t *axis, float range, float drift, float before)
{
    const float noise = axis->work.kick.noise;
    float ring = dahl_larger(0, range - drift - noise) / 2 * axis->work.kick.ring;
    float creep = dahl_larger(0, drift - noise) / WATCH_S;
    if (ring + PEAK_OVER_CREEP * creep <= REST_SPEED) {
        return RESTS;
    }
    if (range < SETTLING_SHARE * before) {
        return SETTLES;
    }
    return ring > REST_SPEED ? SWINGS : CREEPS;
}

static window_t check_window(dahl_commission_t *axis)
{
    axis->work.kick.low = dahl_smaller(axis->work.kick.low, axis->theta);
    axis->work.kick.high = dahl_larger(axis->work.kick.high, axis->theta);
    if (axis->step_ticks % dahl_ticks(axis, WATCH_S) != 0) {
        return NOT_ENDED;
    }
    const float range = axis->work.kick.high - axis->work.kick.low, before = axis->work.kick.ranges[1];
    const float drift = dahl_absolute(axis->theta - axis->work.kick.first);
    axis->work.kick.ranges[1] = axis->work.kick.ranges[0];
    axis->work.kick.ranges[0] = range;
    axis->work.kick.windows++;
    start_window(axis);
    return classify(axis, range, drift, before);
}

/** Count a swing: repeat all kicks with a longer length_long, or end. */
static void fail_kick(dahl_commission_t *axis)
{
    axis->result.elastic = 1;
    axis->work.kick.kick = 0;
    if (++axis->work.kick.fails <= MAX_FAILS) {
        axis->result.length.most *= LENGTH_FACTOR;
        dahl_return_to_middle(axis);
    } else if (axis->work.kick.gain == 0) {
        dahl_refuse(axis, DAHL_COMMISSION_SWINGS);
    } else {
        finish_kicks(axis);
    }
}

/** After a creep, repeat the strong pushes with the next lower gain. */
static void lower_gain(dahl_commission_t *axis)
{
    if (axis->work.kick.gain == 0) {
        dahl_refuse(axis, DAHL_COMMISSION_SWINGS);
        return;
    }
    axis->work.kick.gain--;
    axis->work.kick.creeps++;
    axis->work.kick.kick = 2;
    dahl_return_to_middle(axis);
}

/** Return the index of the highest gain that is left. If little friction is left, the load of an elastic axis can swing:
 * the softer its shaft, the more friction must stay. If only faster sines showed the rotor, a shaft may be hidden. */
static int highest_gain(const dahl_commission_t *axis)
{
    const int left = GAINS - 1 - axis->work.kick.creeps;
    const int highest = axis->has_soft_shaft ? 0 : axis->result.elastic ? GAINS - 2 : GAINS - 1;
    return left > highest ? highest : left;
}

/** Count a kick after which the axis rests. After the last one, the gain has passed. */
static void pass_kick(dahl_commission_t *axis)
{
    const int highest = highest_gain(axis), last = axis->work.kick.gain >= highest ? 4 : 2;
    dahl_return_to_middle(axis);
    if (++axis->work.kick.kick < last) {
        return;
    }
    axis->work.kick.kick = 0;
    axis->result.gain = gains[axis->work.kick.gain];
    if (++axis->work.kick.gain > highest) {
        finish_kicks(axis);
    }
}

static void settle_tick(dahl_commission_t *axis)
{
    const float excursion = dahl_absolute(axis->theta) - axis->config.travel;
    window_t window = check_window(axis);
    const uint8_t windows = axis->work.kick.windows;
    if (window == RESTS) {
        pass_kick(axis);
    } else if (window == CREEPS && windows >= (axis->work.kick.gain == GAINS - 1 ? FIRST_WINDOWS : CREEP_WINDOWS)) {
        lower_gain(axis);
    } else if (excursion > MAX_EXCURSION_RAD || (window == SWINGS && windows >= SWING_WINDOWS)
               || windows >= MAX_WINDOWS) {
        fail_kick(axis);
    }
}

static void next_phase(dahl_commission_t *axis)
{
    axis->work.kick.phase = axis->work.kick.phase == FADE_IN ? PUSH : SETTLE;
    axis->step_ticks = 0;
    start_window(axis);
}

static void wait_tick(dahl_commission_t *axis)
{
    if (dahl_wait_in_middle(axis, 0.05f)) {
        start_kick(axis);
    }
}

static void fade_tick(dahl_commission_t *axis)
{
    if (axis->step_ticks > dahl_ticks(axis, FADE_S)) {
        next_phase(axis);
    }
}

static void kick_push_tick(dahl_commission_t *axis)
{
    axis->command.torque += axis->work.kick.push;
    if (!is_pushing(axis)) {
        next_phase(axis);
    }
}

void dahl_kick_tick(dahl_commission_t *axis, int32_t dcounts)
{
    if (axis->step == 0) {
        wait_tick(axis);
        return;
    }
    if (axis->work.kick.phase < FADE_IN) {
        prepare_tick(axis);
        return;
    }
    axis->step_ticks++;
    axis->command.torque = dahl_commission_load(axis, axis->theta) + compensate(axis, dcounts);
    if (axis->work.kick.phase == FADE_IN) {
        fade_tick(axis);
    } else if (axis->work.kick.phase == PUSH) {
        kick_push_tick(axis);
    } else {
        settle_tick(axis);
    }
}

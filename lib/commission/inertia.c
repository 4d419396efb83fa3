/* SPDX-License-Identifier: MIT */
/** Stage 5: inertia, and the delay from reading to torque, by strokes at a constant speed with three sines on it.
 *
 * The axis never reverses within a window, so friction only adds a constant. Torque and speed are demodulated at
 * each frequency w under a Hann window, which a constant and the other sines do not pass. Their ratio is
 *     torque/speed = (i w inertia + viscous) exp(i w delay).
 * Its phase over i is w delay - viscous/(w inertia): two frequencies separate delay and viscous friction. Noise of the
 * encoder averages out, because the phase of the sines is known.
 *
 * A shaft makes the inertia depend on the frequency: inertia(w) = rotor + load/(1 - w^2/a). The load alone rings on the shaft
 * at w^2 = a. The bound is the lightest rotor of all a that explain the sines within their errors. If the shaft is too soft
 * for the sines, they are repeated at lower frequencies. */
#include "commission.h"

#define SINE_STROKES 5                 /* the first one is not sampled */
#define MEAN_SPEED 2.0f                /* rad/s, less if the travel is short */
#define SPEED_PER_TRAVEL 5.7f          /* 1/s */
#define SINE_ACCELERATION 60.0f        /* rad/s2 of a stroke */
#define SINE_SETTLE_S 0.04f
#define AXIS_WINDOW_S 0.25f
#define MIN_SHARE 0.1f                 /* least speed of a sine over that of its reference */
#define MAX_FACTOR 5.0f                /* of the inertia over that of the configuration */
#define MAX_TANGENT 1.2f               /* of the phase less the guess */
#define MAX_GUESS_RAD 1.3f
#define SAMPLING_ERROR (1.0f / 12)     /* of the inertia, over (w period)^2: torque and speed are means over a tick */
#define LAG_ERROR (1.0f / 16)          /* more, and its interval: a current lag of up to half a tick */
#define INERTIA_ERROR 0.006f           /* of each sine, of the inertia */
#define ELASTIC_ERROR 0.01f            /* more, of an elastic axis */
#define COUNT_ERROR 0.018f             /* more, for a noise of a count over the amplitude of the sine */
#define SOFTEST_OVER_SINE 1.15f        /* the load rings at least at this multiple of the slowest sine */
#define ROTOR_SHARE 0.93f              /* of the bound: damping of the shaft, and friction on its load */
#define STIFFEST_HZ 160.0f             /* resonance of the stiffest shaft of an elastic axis */
#define HIDDEN_HZ 110.0f               /* the same of an axis whose sines show no shaft */
#define SHAFT_STEP 1.015f              /* from one w^2 of a shaft to the next */
#define SLOW_SHARE 0.42f               /* of the mean speed, after its low-pass: then the axis does not reverse */
#define WEAKER 0.97f                   /* sines in a tick in which the axis is slower */
#define LOUD_SPEED_SHARE 0.6f          /* of the speed limit: beyond it a resonance is near, and the sines stop */
#define DELAY_ERROR_TICKS 0.05f        /* the error of the fastest sine comes on top */
#define ELASTIC_DELAY_ERROR_TICKS 0.1f /* more, of an elastic axis */

enum { SINES = DAHL_COMMISSION_SINES, SETS = 2 };

static const float periods[SETS][SINES] = {{4, 7, 11}, {3, 5, 7}}; /* in a window: 16, 28, 44 Hz; 12, 20, 28 Hz */
static const float sine_shares[SINES] = {0.2f, 0.12f, 0.12f};      /* speed of the sines over the mean speed */

/** Return the frequency of a sine in rad/s. */
static float frequency_of(const dahl_commission_t *axis, int k)
{
    const uint32_t ticks = dahl_ticks(axis, AXIS_WINDOW_S);
    return AXIS_TWO_PI * periods[axis->work.inertia.set][k] / ((float)ticks * axis->config.period);
}

static void start_motion(dahl_commission_t *axis)
{
    const uint32_t ticks = dahl_ticks(axis, AXIS_WINDOW_S);
    const float speed = dahl_smaller(MEAN_SPEED, SPEED_PER_TRAVEL * axis->config.travel);
    for (int k = 0; k < SINES; k++) {
        axis->work.inertia.sine[k][0] = 1;
        axis->work.inertia.sine[k][1] = 0;
        dahl_small_turn(frequency_of(axis, k) * axis->config.period, axis->work.inertia.turn[k]);
        for (int half = 0; half < 2; half++) {
            for (int part = 0; part < 2; part++) {
                axis->work.inertia.torque[half][k][part] = 0;
                axis->work.inertia.speed[half][k][part] = 0;
            }
        }
    }
    dahl_small_turn(AXIS_TWO_PI / (float)ticks, axis->work.inertia.window_turn);
    axis->work.inertia.stroke = 0;
    axis->work.inertia.mean_speed = speed;
    axis->work.inertia.share = 1;
    axis->work.inertia.base = axis->command;
    dahl_next_step(axis);
}

/** Start the next stroke of the base motion. The last one goes to the middle. */
static void next_stroke(dahl_commission_t *axis)
{
    uint8_t stroke = ++axis->work.inertia.stroke;
    float end = stroke & 1 ? axis->config.travel : -axis->config.travel;
    dahl_stroke_to(axis, stroke > SINE_STROKES ? 0 : end, axis->work.inertia.mean_speed, SINE_ACCELERATION);
    axis->work.inertia.window[0] = 1;
    axis->work.inertia.window[1] = 0;
}

/** Return 1 if the axis almost stops, so that friction is no constant. */
static int is_slow(const dahl_commission_t *axis)
{
    float direction = axis->stroke.speed < 0 ? -1.0f : 1.0f;
    return direction * axis->speed < SLOW_SHARE * axis->work.inertia.mean_speed;
}

/** Return the share of the sines, 0 to 1. It rises in the first stroke and falls in the last one. A loop that amplifies the
 * sines must not reverse the axis, because friction then changes its sign. */
static float envelope(dahl_commission_t *axis)
{
    const uint32_t tick = axis->stroke.tick, first = axis->stroke.ramp_ticks + dahl_ticks(axis, SINE_SETTLE_S);
    const int is_cruise = tick > first && tick < axis->stroke.ramp_ticks + axis->stroke.cruise_ticks;
    if (is_cruise && is_slow(axis)) {
        axis->work.inertia.share *= WEAKER;
    }
    float part = (float)tick / (float)(2 * axis->stroke.ramp_ticks + axis->stroke.cruise_ticks);
    part = axis->work.inertia.stroke == 1 ? part : axis->work.inertia.stroke > SINE_STROKES ? 1 - part : 1;
    return part * axis->work.inertia.share;
}

/** Add the sines to the base motion. */
static void add_sines(dahl_commission_t *axis)
{
    const float share = envelope(axis);
    for (int k = 0; k < SINES; k++) {
        const float speed = sine_shares[k] * share * axis->work.inertia.mean_speed;
        float *sine = axis->work.inertia.sine[k];
        const float frequency = frequency_of(axis, k);
        dahl_rotate(sine, axis->work.inertia.turn[k]);
        axis->command.angle += speed / frequency * sine[1];
        axis->command.speed += speed * sine[0];
        axis->command.acceleration -= speed * frequency * sine[1];
    }
}

/** Demodulate one tick: the torque less the load, and the speed less that of the base motion. */
static void add_to_sines(dahl_commission_t *axis, int32_t dcounts, float base_speed)
{
    float speed = (float)dcounts * axis->config.theta_per_count / axis->config.period - base_speed;
    float torque = axis->torque - dahl_commission_load(axis, axis->theta);
    uint32_t first = axis->stroke.ramp_ticks + dahl_ticks(axis, SINE_SETTLE_S);
    uint32_t tick = axis->stroke.tick, stroke = axis->work.inertia.stroke;
    if (stroke < 2 || stroke > SINE_STROKES || tick < first || tick >= first + dahl_ticks(axis, AXIS_WINDOW_S)) {
        return;
    }
    const int half = stroke > 1 + SINE_STROKES / 2;
    const float weight = 1 - axis->work.inertia.window[0];
    dahl_rotate(axis->work.inertia.window, axis->work.inertia.window_turn);
    for (int k = 0; k < SINES; k++) {
        const float *sine = axis->work.inertia.sine[k];
        axis->work.inertia.torque[half][k][0] += weight * torque * sine[0];
        axis->work.inertia.torque[half][k][1] -= weight * torque * sine[1];
        axis->work.inertia.speed[half][k][0] += weight * speed * sine[0];
        axis->work.inertia.speed[half][k][1] -= weight * speed * sine[1];
    }
}

/** Return the angle of a tangent up to 1.2, within 1.5 %. */
static float angle_of(float tangent)
{
    float square = tangent * tangent;
    return tangent * (15 + 4 * square) / (15 + 9 * square);
}

/** Write torque/speed over i at a sine: real and imaginary part. Return 0 if the sine did not move the axis. */
static int find_ratio(const dahl_commission_t *axis, const float torque[2], const float speed[2], float least, float ratio[2])
{
    float square = speed[0] * speed[0] + speed[1] * speed[1];
    const uint32_t ticks = dahl_ticks(axis, AXIS_WINDOW_S);
    least *= axis->work.inertia.mean_speed * (float)ticks;
    if (!(square > least * least)) {
        return 0;
    }
    ratio[0] = (torque[1] * speed[0] - torque[0] * speed[1]) / square;
    ratio[1] = -(torque[0] * speed[0] + torque[1] * speed[1]) / square;
    return 1;
}

/** Write the inertia that the sine shows, its phase near `guess`, and the difference of the halves of the strokes. The inertia
 * is negative if the load swings against the rotor. Return 0 if the sine did not move the axis, or if its phase is too large. */
static int find_inertia(dahl_commission_t *axis, int k, float guess, float *phase)
{
    const float w = frequency_of(axis, k), least = MIN_SHARE * sine_shares[k] * (SINE_STROKES - 1) / 4;
    float half[2][2], all[2], turn[2], torque[2], speed[2];
    for (int part = 0; part < 2; part++) {
        torque[part] = axis->work.inertia.torque[0][k][part] + axis->work.inertia.torque[1][k][part];
        speed[part] = axis->work.inertia.speed[0][k][part] + axis->work.inertia.speed[1][k][part];
    }
    if (!find_ratio(axis, torque, speed, 2 * least, all)) {
        return 0;
    }
    for (int h = 0; h < 2; h++) {
        if (!find_ratio(axis, axis->work.inertia.torque[h][k], axis->work.inertia.speed[h][k], least / 2, half[h])) {
            return 0;
        }
    }
    dahl_small_turn(guess, turn);
    float along = all[0] * turn[0] + all[1] * turn[1], across = all[1] * turn[0] - all[0] * turn[1];
    float size = dahl_root(all[0] * all[0] + all[1] * all[1]);
    const float sampling = 1 - (SAMPLING_ERROR + LAG_ERROR) * w * w * axis->config.period * axis->config.period;
    axis->work.inertia.inertia[k] = (along < 0 ? -size : size) * sampling / w;
    float difference = (half[1][0] - half[0][0]) * turn[0] + (half[1][1] - half[0][1]) * turn[1];
    axis->work.inertia.difference[k] = dahl_absolute(difference) / (2 * w);
    *phase = guess + angle_of(across / along);
    return dahl_absolute(across) < MAX_TANGENT * dahl_absolute(along);
}

/** Return the error that a current lag of up to half a tick makes in the inertia at a sine. It has the same sign at all sines. */
static float lag_error(const dahl_commission_t *axis, int k)
{
    const float turn = frequency_of(axis, k) * axis->config.period;
    return LAG_ERROR * turn * turn * axis->work.inertia.inertia[0];
}

/** Return the error of the inertia at a sine that does not depend on the errors of the other sines. */
static float own_error(const dahl_commission_t *axis, int k)
{
    const float amplitude = sine_shares[k] * axis->work.inertia.mean_speed / frequency_of(axis, k);
    const float counts = (float)(axis->result.noise + 1) * axis->config.theta_per_count / amplitude;
    const float *inertia = axis->work.inertia.inertia;
    return (INERTIA_ERROR + COUNT_ERROR * counts) * dahl_larger(inertia[0], dahl_absolute(inertia[k]))
           + axis->work.inertia.difference[k];
}

/** Write the errors of the sines, and that of the difference of the first and the last one. */
static void find_errors(dahl_commission_t *axis)
{
    float own[SINES], *error = axis->work.inertia.error;
    for (int k = 0; k < SINES; k++) {
        own[k] = own_error(axis, k);
        error[k] = own[k] + lag_error(axis, k);
    }
    axis->work.inertia.slope_error = dahl_root(own[0] * own[0] + own[2] * own[2]) + lag_error(axis, 2) - lag_error(axis, 0);
}

/** Widen the errors of an elastic axis: the damping of its shaft and friction on its load are not in the model. */
static void widen_errors(dahl_commission_t *axis)
{
    float *error = axis->work.inertia.error;
    for (int k = 0; k < SINES; k++) {
        error[k] += ELASTIC_ERROR * axis->work.inertia.inertia[0];
    }
    axis->work.inertia.slope_error = error[0] + error[2];
}

/** Return the delay of an elastic axis. The damping of its shaft looks like viscous friction that grows with the frequency, so
 * the delay comes from one sine at a time. */
static float elastic_delay(const dahl_commission_t *axis)
{
    const float *inertia = axis->work.inertia.inertia;
    float delay = 0;
    for (int k = inertia[1] > 0 ? 1 : 0; k < SINES && inertia[k] > 0; k++) {
        float w = frequency_of(axis, k);
        delay = dahl_larger(delay, (axis->work.inertia.phase[k] + axis->result.viscous.best / (w * inertia[k])) / w);
    }
    return delay;
}

/** Return the inertia that a sine shows without the viscous friction, which has the phase that the delay leaves. */
static float inertia_without_friction(const dahl_commission_t *axis, int k, float delay)
{
    float turn[2];
    dahl_small_turn(dahl_axis_clamp(axis->work.inertia.phase[k] - frequency_of(axis, k) * delay, 1), turn);
    return axis->work.inertia.inertia[k] * turn[0];
}

/** Write the delay and whether the axis is elastic. */
static void find_delay(dahl_commission_t *axis)
{
    const float period = axis->config.period, w0 = frequency_of(axis, 0), w2 = frequency_of(axis, 2);
    const float *inertia = axis->work.inertia.inertia, *phase = axis->work.inertia.phase;
    float delay = (w2 * phase[2] - w0 * phase[0]) / (w2 * w2 - w0 * w0);
    find_errors(axis);
    const float slow = inertia_without_friction(axis, 0, delay), fast = inertia_without_friction(axis, 2, delay);
    const float spread = dahl_absolute(fast - slow), fastest = axis->work.inertia.error[2];
    float error = DELAY_ERROR_TICKS * period + fastest / (inertia[0] * w2);
    axis->result.elastic = spread > fastest + axis->work.inertia.error[0] / 2 || axis->work.inertia.set != 0;
    if (axis->result.elastic) {
        widen_errors(axis);
        delay = elastic_delay(axis);
        error += ELASTIC_DELAY_ERROR_TICKS * period;
    }
    delay = dahl_larger(0.1f * period, delay);
    axis->result.delay = (dahl_commission_range_t){dahl_larger(0, delay - error), delay, delay + error};
}

/** Take the viscous friction off the inertia, and start the search of the shaft. */
static void start_search(dahl_commission_t *axis)
{
    float *inertia = axis->work.inertia.inertia, w = SOFTEST_OVER_SINE * frequency_of(axis, 0);
    for (int k = 0; k < SINES; k++) {
        inertia[k] = inertia_without_friction(axis, k, axis->result.delay.best);
    }
    axis->result.inertia = (dahl_commission_range_t){inertia[0], inertia[0], inertia[0]};
    axis->work.inertia.gap = inertia[0];
    axis->work.inertia.shaft = w * w;
}

/** Take a shaft on which the load alone rings at w^2 = a. If it explains the three sines, widen the result. */
static void try_shaft(dahl_commission_t *axis, float a)
{
    const float *inertia = axis->work.inertia.inertia;
    const float stiffest = AXIS_TWO_PI * (axis->result.elastic ? STIFFEST_HZ : HIDDEN_HZ);
    dahl_commission_range_t *result = &axis->result.inertia;
    float u[SINES];
    for (int k = 0; k < SINES; k++) {
        float w = frequency_of(axis, k);
        u[k] = a / (a - w * w);
    }
    const float all = u[2] - u[0], part = (u[1] - u[0]) / all, heavier = inertia[2] - inertia[0];
    float gap = inertia[0] + part * heavier - inertia[1];
    const float ends = dahl_absolute(part) * axis->work.inertia.error[2] + dahl_absolute(1 - part) * axis->work.inertia.error[0];
    if (dahl_absolute(gap) > axis->work.inertia.error[1] + ends) {
        return;
    }
    float load = heavier / all, error = axis->work.inertia.slope_error / dahl_absolute(all);
    float least = inertia[0] - (dahl_absolute(load) + error) * u[0], total = inertia[0] - load * (u[0] - 1);
    least = dahl_larger(least, total * a / (stiffest * stiffest));
    result->least = dahl_smaller(result->least, least);
    result->most = dahl_larger(result->most, total);
    if (dahl_absolute(gap) < axis->work.inertia.gap) {
        axis->work.inertia.gap = dahl_absolute(gap);
        result->best = total;
    }
}

/** Repeat the stage with slower sines, because a shaft is too soft. Refuse if there are none. */
static void try_slower(dahl_commission_t *axis)
{
    if (++axis->work.inertia.set == SETS) {
        dahl_refuse(axis, DAHL_COMMISSION_BAD_INERTIA);
        return;
    }
    dahl_return_to_middle(axis);
}

/** After the strokes, evaluate one sine in each tick, then the delay, then one shaft in each tick. */
static void start_evaluation(dahl_commission_t *axis)
{
    axis->work.inertia.evaluated = 0;
    axis->work.inertia.shaft = 0;
    dahl_next_step(axis);
    axis->command.mode = DAHL_COMMISSION_TORQUE;
    axis->command.torque = dahl_commission_load(axis, axis->theta);
}

static void evaluate_sine(dahl_commission_t *axis)
{
    const uint8_t k = axis->work.inertia.evaluated++;
    float *phase = axis->work.inertia.phase, guess = 0;
    if (k == SINES) {
        find_delay(axis);
        return;
    }
    if (k > SINES) {
        start_search(axis);
        return;
    }
    if (k > 0) {
        guess = dahl_smaller(MAX_GUESS_RAD, phase[0] * frequency_of(axis, k) / frequency_of(axis, 0));
    }
    if (!find_inertia(axis, k, guess, &phase[k]) || !(axis->work.inertia.inertia[0] > 0)) {
        try_slower(axis);
    }
}

static void search_tick(dahl_commission_t *axis)
{
    dahl_commission_range_t *result = &axis->result.inertia;
    const float stiffest = AXIS_TWO_PI * (axis->result.elastic ? STIFFEST_HZ : HIDDEN_HZ);
    if (axis->work.inertia.shaft < stiffest * stiffest) {
        try_shaft(axis, axis->work.inertia.shaft);
        axis->work.inertia.shaft *= SHAFT_STEP;
        return;
    }
    float ratio = result->best / axis->config.inertia, error = axis->work.inertia.error[1] + INERTIA_ERROR * result->best;
    if (!(ratio > 1 / MAX_FACTOR && ratio < MAX_FACTOR && axis->work.inertia.gap < axis->work.inertia.inertia[0])) {
        try_slower(axis);
        return;
    }
    if (!axis->result.elastic) {
        result->best = (axis->work.inertia.inertia[0] + axis->work.inertia.inertia[1]) / 2;
    }
    result->least = dahl_smaller((axis->result.elastic ? ROTOR_SHARE : 1) * result->least, result->best - error);
    result->most = dahl_larger(result->most, result->best + error);
    dahl_enter(axis, DAHL_COMMISSION_KICK);
    dahl_return_to_middle(axis);
}

static void shaft_tick(dahl_commission_t *axis)
{
    if (axis->work.inertia.shaft > 0) {
        search_tick(axis);
    } else {
        evaluate_sine(axis);
    }
}

void dahl_inertia_tick(dahl_commission_t *axis, int32_t dcounts)
{
    if (axis->step == 0) {
        if (dahl_stroke_tick(axis)) {
            start_motion(axis);
            next_stroke(axis);
        }
        return;
    }
    if (axis->step == 2) {
        shaft_tick(axis);
        return;
    }
    if (dahl_absolute(axis->speed) > dahl_larger(LOUD_SPEED_SHARE * axis->config.speed_limit, 2 * MEAN_SPEED)) {
        try_slower(axis);
        return;
    }
    add_to_sines(axis, dcounts, axis->work.inertia.base.speed);
    axis->command.angle = axis->work.inertia.base.angle;
    axis->command.speed = axis->work.inertia.base.speed;
    int is_end = dahl_stroke_tick(axis);
    if (is_end && axis->work.inertia.stroke > SINE_STROKES) {
        start_evaluation(axis);
        return;
    }
    if (is_end) {
        next_stroke(axis);
    }
    axis->work.inertia.base = axis->command;
    add_sines(axis);
}

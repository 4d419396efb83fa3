/* SPDX-License-Identifier: MIT */
/** Stage 5: strokes at a constant speed with two sines on it; inertia, and the time from command to motion.
 *
 * The axis never reverses within a window, so friction only adds a constant. Torque and speed are demodulated at both
 * frequencies w under a Hann window, which a constant and the other sine do not pass. Their ratio is
 *     torque/speed = (i w inertia + viscous) exp(i w delay).
 * Its phase over i is w delay - viscous/(w inertia): two frequencies separate delay and viscous friction. Noise of the
 * encoder averages out, because the phase of the sines is known. */
#include "commission.h"

#define STROKES 5             /* the first one is not sampled */
#define MEAN_SPEED 2.0f       /* rad/s, less if the travel is short */
#define SPEED_PER_TRAVEL 5.7f /* 1/s */
#define SINE_SHARE 0.25f      /* of the mean speed, for each sine */
#define ACCELERATION 60.0f    /* rad/s2 of a stroke */
#define SETTLE_S 0.04f
#define WINDOW_S 0.25f
#define MIN_SHARE 0.3f        /* least speed of a sine over that of its reference */
#define MAX_FACTOR 5.0f       /* of the inertia over that of the configuration */
#define MAX_PHASE 1.2f        /* tangent */
#define MAX_SPREAD 0.3f       /* of the inertia at both frequencies */
#define ELASTIC_SPREAD 0.04f  /* a shaft makes the load lighter or heavier at the faster sine */
#define INERTIA_ERROR 0.02f   /* half interval; the spread over the frequencies comes on top */
#define DELAY_ERROR 0.2f      /* ticks; errors of 0.05 were seen */

static const float periods[DAHL_COMMISSION_SINES] = {4, 7}; /* in a window: 16 and 28 Hz */

static void start_motion(dahl_commission_t *axis)
{
    const float ticks = (float)dahl_ticks(axis, WINDOW_S);
    const float speed = dahl_smaller(MEAN_SPEED, SPEED_PER_TRAVEL * axis->config.travel);
    for (int k = 0; k < DAHL_COMMISSION_SINES; k++) {
        axis->work.inertia.sine[k][0] = 1;
        dahl_small_turn(TWO_PI * periods[k] / ticks, axis->work.inertia.turn[k]);
    }
    dahl_small_turn(TWO_PI / ticks, axis->work.inertia.window_turn);
    axis->work.inertia.mean_speed = speed;
    axis->work.inertia.base = axis->command;
    dahl_next_step(axis);
}

/** Start the next stroke of the base motion. The last one goes to the middle. */
static void next_stroke(dahl_commission_t *axis)
{
    uint8_t stroke = ++axis->work.inertia.stroke;
    float end = stroke & 1 ? axis->config.travel : -axis->config.travel;
    dahl_stroke_to(axis, stroke > STROKES ? 0 : end, axis->work.inertia.mean_speed, ACCELERATION);
    axis->work.inertia.window[0] = 1;
    axis->work.inertia.window[1] = 0;
}

/** Return the share of the sines: it rises in the first stroke and falls in the last one. */
static float envelope(const dahl_commission_t *axis)
{
    float ticks = (float)(2 * axis->stroke.ramp_ticks + axis->stroke.cruise_ticks);
    float share = dahl_smaller(1, (float)axis->stroke.tick / ticks);
    return axis->work.inertia.stroke == 1 ? share : axis->work.inertia.stroke > STROKES ? 1 - share : 1;
}

/** Add the sines to the base motion. */
static void add_sines(dahl_commission_t *axis)
{
    const float speed = SINE_SHARE * envelope(axis) * axis->work.inertia.mean_speed;
    for (int k = 0; k < DAHL_COMMISSION_SINES; k++) {
        float *sine = axis->work.inertia.sine[k];
        float frequency = TWO_PI * periods[k] / ((float)dahl_ticks(axis, WINDOW_S) * axis->config.period);
        dahl_rotate(sine, axis->work.inertia.turn[k]);
        axis->command.angle += speed / frequency * sine[1];
        axis->command.speed += speed * sine[0];
        axis->command.acceleration -= speed * frequency * sine[1];
    }
}

/** Demodulate one tick: the torque that is not load, and the speed over that of the base motion. */
static void add_sample(dahl_commission_t *axis, int32_t dcounts, float base_speed)
{
    float speed = (float)dcounts * axis->config.theta_per_count / axis->config.period - base_speed;
    float torque = axis->torque - dahl_commission_load(axis, axis->theta);
    uint32_t first = axis->stroke.ramp_ticks + dahl_ticks(axis, SETTLE_S);
    uint32_t tick = axis->stroke.tick, stroke = axis->work.inertia.stroke;
    if (stroke < 2 || stroke > STROKES || tick < first || tick >= first + dahl_ticks(axis, WINDOW_S)) {
        return;
    }
    float weight = 1 - axis->work.inertia.window[0];
    dahl_rotate(axis->work.inertia.window, axis->work.inertia.window_turn);
    for (int k = 0; k < DAHL_COMMISSION_SINES; k++) {
        const float *sine = axis->work.inertia.sine[k];
        axis->work.inertia.torque[k][0] += weight * torque * sine[0];
        axis->work.inertia.torque[k][1] -= weight * torque * sine[1];
        axis->work.inertia.speed[k][0] += weight * speed * sine[0];
        axis->work.inertia.speed[k][1] -= weight * speed * sine[1];
    }
}

/** Return the angle of a tangent up to 1.2, within 1.5 %. */
static float angle_of(float tangent)
{
    float square = tangent * tangent;
    return tangent * (15 + 4 * square) / (15 + 9 * square);
}

/** Write torque/speed over i: size and phase. Return 0 if the sine did not move the axis, or if the phase is large. */
static int find_ratio(const dahl_commission_t *axis, int k, float *size, float *phase)
{
    const float *torque = axis->work.inertia.torque[k], *speed = axis->work.inertia.speed[k];
    float square = speed[0] * speed[0] + speed[1] * speed[1];
    float weights = (float)(STROKES - 1) * (float)dahl_ticks(axis, WINDOW_S);
    float least = MIN_SHARE * SINE_SHARE * axis->work.inertia.mean_speed * weights / 2;
    if (!(square > least * least)) {
        return 0;
    }
    float real = (torque[1] * speed[0] - torque[0] * speed[1]) / square;
    float imaginary = -(torque[0] * speed[0] + torque[1] * speed[1]) / square;
    if (!(real > 0 && dahl_absolute(imaginary) < MAX_PHASE * real)) {
        return 0;
    }
    *size = dahl_root(real * real + imaginary * imaginary);
    *phase = angle_of(imaginary / real);
    return 1;
}

/** Write the results from size and phase of both sines. */
static void write_result(dahl_commission_t *axis, const float size[], const float phase[])
{
    dahl_commission_result_t *result = &axis->result;
    const float period = axis->config.period, unit = TWO_PI / ((float)dahl_ticks(axis, WINDOW_S) * period);
    float w[DAHL_COMMISSION_SINES], inertia[DAHL_COMMISSION_SINES];
    for (int k = 0; k < DAHL_COMMISSION_SINES; k++) {
        w[k] = unit * periods[k];
    }
    float delay = (w[1] * phase[1] - w[0] * phase[0]) / (w[1] * w[1] - w[0] * w[0]);
    for (int k = 0; k < DAHL_COMMISSION_SINES; k++) {
        float turn[2]; /* of viscous friction alone */
        dahl_small_turn(dahl_clamp(phase[k] - w[k] * delay, 1), turn);
        inertia[k] = size[k] * turn[0] / w[k];
    }
    float best = (inertia[0] + inertia[1]) / 2, spread = dahl_absolute(inertia[1] - inertia[0]);
    result->elastic = spread > ELASTIC_SPREAD * best;
    float error = INERTIA_ERROR * best + spread / 2;
    result->inertia = (dahl_commission_range_t){best - error, best, best + error};
    delay = dahl_larger(0.1f * period, delay);
    result->delay = (dahl_commission_range_t){dahl_larger(0, delay - DELAY_ERROR * period), delay,
                                              delay + DELAY_ERROR * period};
}

static void finish(dahl_commission_t *axis)
{
    float size[DAHL_COMMISSION_SINES], phase[DAHL_COMMISSION_SINES];
    for (int k = 0; k < DAHL_COMMISSION_SINES; k++) {
        if (!find_ratio(axis, k, &size[k], &phase[k])) {
            dahl_refuse(axis, DAHL_COMMISSION_BAD_INERTIA);
            return;
        }
    }
    write_result(axis, size, phase);
    const dahl_commission_range_t *inertia = &axis->result.inertia;
    float ratio = inertia->best / axis->config.inertia, half = inertia->best - inertia->least;
    if (!(ratio > 1 / MAX_FACTOR && ratio < MAX_FACTOR && half < MAX_SPREAD * inertia->best)) {
        dahl_refuse(axis, DAHL_COMMISSION_BAD_INERTIA);
        return;
    }
    dahl_enter(axis, DAHL_COMMISSION_KICK);
    dahl_return_to_middle(axis);
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
    add_sample(axis, dcounts, axis->work.inertia.base.speed);
    axis->command.angle = axis->work.inertia.base.angle;
    axis->command.speed = axis->work.inertia.base.speed;
    int is_end = dahl_stroke_tick(axis);
    if (is_end && axis->work.inertia.stroke > STROKES) {
        finish(axis);
        return;
    }
    if (is_end) {
        next_stroke(axis);
    }
    axis->work.inertia.base = axis->command;
    add_sines(axis);
}

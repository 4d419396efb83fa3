/* SPDX-License-Identifier: MIT */
/** Stage 5: a motion of two frequencies; inertia, and the time from command to motion.
 *
 * Model: torque(t - lag) - load = inertia acceleration + Fc bristle + viscous speed + constant + slope angle. Both sides
 * pass the same low-pass. The normal equations do not depend on the lag, so they are factored once and solved for each lag.
 * A parabola through the squares of the residual refines the best lag. */
#include "commission.h"

#define LAGS DAHL_COMMISSION_LAGS
#define UNKNOWNS 5
#define RATIO 2.6f             /* of the two frequencies */
#define SLOW_SHARE 0.6f        /* of the speed */
#define FAST_SHARE 0.4f
#define STRIDE_S 0.75e-3f      /* least time between two samples of the sums */
#define MAX_SPEED 6.0f         /* rad/s */
#define MIN_ACCELERATION 8.0f  /* rad/s2 */
#define MAX_ACCELERATION 150.0f
#define MIN_HZ 1.5f
#define FILTER_HZ 80.0f        /* at most */
#define RISE_PERIODS 2.0f
#define PERIODS 7.0f
#define MIN_SAMPLES 100u
#define MAX_RESIDUAL 0.3f      /* of the square of the torque */
#define MAX_FACTOR 5.0f        /* of the inertia over that of the configuration */
#define INERTIA_ERROR 0.06f    /* half interval: measured on random axes */
#define LAG_ERROR 0.5f         /* strides */
#define DELAY_ERROR 0.8f       /* ticks */

static void start_motion(dahl_commission_t *axis)
{
    const float period = axis->config.period, top = dahl_smaller(MAX_SPEED, 0.6f * axis->config.speed_limit);
    float acceleration = 0.9f * axis->result.Fc.best / axis->config.inertia;
    acceleration = dahl_smaller(MAX_ACCELERATION, dahl_larger(MIN_ACCELERATION, acceleration));
    float amplitude = dahl_smaller(top * top / acceleration, 0.9f * axis->config.travel);
    float frequency = dahl_larger(dahl_root(acceleration / amplitude), TWO_PI * MIN_HZ);
    axis->work.inertia.frequency = frequency;
    axis->work.inertia.acceleration = acceleration;
    axis->work.inertia.amplitude = acceleration / (frequency * frequency);
    axis->work.inertia.share = dahl_low_pass_share(dahl_smaller(FILTER_HZ, 12 * frequency / TWO_PI), period);
    axis->work.inertia.stride = 1 + (uint32_t)(STRIDE_S / period);
    axis->work.inertia.rotor[0] = axis->work.inertia.rotor[2] = 1;
    dahl_small_turn(frequency * period, &axis->work.inertia.turn[0]);
    dahl_small_turn(RATIO * frequency * period, &axis->work.inertia.turn[2]);
    axis->work.inertia.filter[2] = axis->work.inertia.filter[3] = axis->theta;
    axis->work.inertia.angle = axis->theta;
    dahl_next_step(axis);
}

/** Return the share of the amplitude: it rises in two periods and ends within the last one. */
static float envelope(float periods)
{
    return dahl_larger(0, dahl_smaller(dahl_smaller(1, periods / RISE_PERIODS), PERIODS - periods));
}

static void move_reference(dahl_commission_t *axis, float share)
{
    const float frequency = axis->work.inertia.frequency, amplitude = share * axis->work.inertia.amplitude;
    const float *rotor = axis->work.inertia.rotor;
    dahl_rotate(&axis->work.inertia.rotor[0], &axis->work.inertia.turn[0]);
    dahl_rotate(&axis->work.inertia.rotor[2], &axis->work.inertia.turn[2]);
    axis->command.angle = amplitude * (SLOW_SHARE * rotor[1] + FAST_SHARE / RATIO * rotor[3]);
    axis->command.speed = amplitude * frequency * (SLOW_SHARE * rotor[0] + FAST_SHARE * rotor[2]);
    axis->command.acceleration =
        -amplitude * frequency * frequency * (SLOW_SHARE * rotor[1] + FAST_SHARE * RATIO * rotor[3]);
}

/** The same two poles for torque and angle. */
static void filter(dahl_commission_t *axis)
{
    float *f = axis->work.inertia.filter, share = axis->work.inertia.share;
    f[0] += share * (axis->torque - dahl_commission_load(axis, axis->theta) - f[0]);
    f[1] += share * (f[0] - f[1]);
    f[2] += share * (axis->theta - f[2]);
    f[3] += share * (f[2] - f[3]);
}

/** Dahl's bristle by an implicit step: no exponential. */
static float move_bristle(dahl_commission_t *axis, float moved)
{
    float step = moved / axis->result.length.best;
    axis->work.inertia.bristle = (axis->work.inertia.bristle + step) / (1 + dahl_absolute(step));
    return axis->work.inertia.bristle;
}

static void add_sums(dahl_commission_t *axis, const float row[UNKNOWNS])
{
    float *sum = axis->work.inertia.matrix;
    for (int i = 0; i < UNKNOWNS; i++) {
        for (int j = 0; j <= i; j++) {
            *sum++ += row[i] * row[j];
        }
    }
    for (int lag = 0; lag < LAGS; lag++) {
        float torque = axis->work.inertia.torque[lag];
        for (int i = 0; i < UNKNOWNS; i++) {
            axis->work.inertia.rhs[lag][i] += torque * row[i];
        }
        axis->work.inertia.square[lag] += torque * torque;
    }
    axis->work.inertia.samples++;
}

/** Differences of the filtered angle are centred at the sample before. Slow samples are left out: presliding is there. */
static void add_sample(dahl_commission_t *axis, float periods)
{
    const float step = axis->config.period * (float)axis->work.inertia.stride, a = axis->work.inertia.acceleration;
    for (int lag = LAGS - 1; lag > 0; lag--) {
        axis->work.inertia.torque[lag] = axis->work.inertia.torque[lag - 1];
    }
    axis->work.inertia.torque[0] = axis->work.inertia.filter[1];
    float before = axis->work.inertia.angle, moved = axis->work.inertia.filter[3] - before;
    float speed = moved / step, mean = 0.5f * (speed + axis->work.inertia.speed);
    float acceleration = (speed - axis->work.inertia.speed) / step;
    float row[UNKNOWNS] = {acceleration / a, move_bristle(axis, moved), mean * axis->work.inertia.frequency / a, 1,
                           before / axis->work.inertia.amplitude};
    axis->work.inertia.angle = axis->work.inertia.filter[3];
    axis->work.inertia.speed = speed;
    if (periods <= RISE_PERIODS) {
        axis->work.inertia.peak = dahl_larger(axis->work.inertia.peak, dahl_absolute(mean));
    } else if (dahl_absolute(mean) > 0.5f * axis->work.inertia.peak) {
        add_sums(axis, row);
    }
}

/** Factor the packed lower matrix by Cholesky, in place. Return 0 if it is singular. */
static int factor(float *matrix)
{
    for (int i = 0; i < UNKNOWNS; i++) {
        float *row = matrix + i * (i + 1) / 2;
        for (int j = 0; j <= i; j++) {
            const float *other = matrix + j * (j + 1) / 2;
            float rest = row[j];
            for (int k = 0; k < j; k++) {
                rest -= row[k] * other[k];
            }
            if (i == j && rest <= 1e-6f * row[i]) {
                return 0;
            }
            row[j] = i == j ? dahl_root(rest) : rest / other[j];
        }
    }
    return 1;
}

/** Solve for one right side, in place. Return the square that the solution explains. */
static float solve(const float *matrix, float rhs[UNKNOWNS])
{
    float explained = 0;
    for (int i = 0; i < UNKNOWNS; i++) {
        const float *row = matrix + i * (i + 1) / 2;
        for (int k = 0; k < i; k++) {
            rhs[i] -= row[k] * rhs[k];
        }
        rhs[i] /= row[i];
        explained += rhs[i] * rhs[i];
    }
    for (int i = UNKNOWNS - 1; i >= 0; i--) {
        for (int k = i + 1; k < UNKNOWNS; k++) {
            rhs[i] -= matrix[k * (k + 1) / 2 + i] * rhs[k];
        }
        rhs[i] /= matrix[i * (i + 1) / 2 + i];
    }
    return explained;
}

/** Return the distance of the lowest point of a parabola from the middle one of three points, within +-1/2. */
static float lowest_point(const float *residual)
{
    float curvature = residual[-1] - 2 * residual[0] + residual[1];
    return curvature > 0 ? dahl_clamp((residual[-1] - residual[1]) / (2 * curvature), 0.5f) : 0;
}

/** Write inertia and delay with their intervals from the solution at the lag `best` + `part`. */
static void write_result(dahl_commission_t *axis, int best, float part)
{
    dahl_commission_result_t *result = &axis->result;
    const float period = axis->config.period, stride = (float)axis->work.inertia.stride;
    const float before = axis->work.inertia.rhs[best - 1][0], after = axis->work.inertia.rhs[best + 1][0];
    float slope = (after - before) / 2, inertia = axis->work.inertia.rhs[best][0] + part * slope;
    float error = INERTIA_ERROR * inertia + LAG_ERROR * dahl_absolute(slope);
    float delay = ((float)best + part - 1) * stride + 0.5f;
    result->inertia.best = inertia / axis->work.inertia.acceleration;
    result->inertia.least = (inertia - error) / axis->work.inertia.acceleration;
    result->inertia.most = (inertia + error) / axis->work.inertia.acceleration;
    result->delay.best = dahl_larger(0.1f, delay) * period;
    result->delay.least = dahl_larger(0, delay - DELAY_ERROR * stride) * period;
    result->delay.most = (dahl_larger(0.1f, delay) + DELAY_ERROR * stride) * period;
}

static void finish(dahl_commission_t *axis)
{
    float residual[LAGS], share = MAX_RESIDUAL;
    int best = 1;
    if (axis->work.inertia.samples < MIN_SAMPLES) {
        dahl_refuse(axis, DAHL_COMMISSION_NO_DATA);
        return;
    }
    int is_solved = factor(axis->work.inertia.matrix);
    for (int lag = 0; is_solved && lag < LAGS; lag++) {
        residual[lag] = axis->work.inertia.square[lag] - solve(axis->work.inertia.matrix, axis->work.inertia.rhs[lag]);
        best = residual[lag] < residual[best] ? lag : best;
    }
    if (!is_solved || best == 0 || best == LAGS - 1 || residual[best] > share * axis->work.inertia.square[best]) {
        dahl_refuse(axis, DAHL_COMMISSION_BAD_INERTIA);
        return;
    }
    write_result(axis, best, lowest_point(&residual[best]));
    float ratio = axis->result.inertia.best / axis->config.inertia;
    if (!(ratio > 1 / MAX_FACTOR && ratio < MAX_FACTOR && axis->result.inertia.least > 0)) {
        dahl_refuse(axis, DAHL_COMMISSION_BAD_INERTIA);
        return;
    }
    dahl_enter(axis, DAHL_COMMISSION_KICK);
    dahl_return_to_middle(axis);
}

void dahl_inertia_tick(dahl_commission_t *axis)
{
    if (axis->step == 0) {
        if (dahl_stroke_tick(axis)) {
            start_motion(axis);
        }
        return;
    }
    axis->step_ticks++;
    float periods = (float)axis->step_ticks * axis->config.period * axis->work.inertia.frequency / TWO_PI;
    move_reference(axis, envelope(periods));
    filter(axis);
    if (axis->step_ticks % axis->work.inertia.stride == 0) {
        add_sample(axis, periods);
    }
    if (periods > PERIODS) {
        finish(axis);
    }
}

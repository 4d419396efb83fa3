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
 * for the sines, the strokes are repeated with slower ones, then with faster ones. If the bound is too low for the compensator,
 * they are repeated with faster ones: above w^2 = a the load swings against the rotor, so that no shaft hides a light one. */
#include "commission.h"

#define SINE_STROKES 5                 /* the first one is not sampled */
#define MEAN_SPEED 2.0f                /* rad/s, less if the travel is short */
#define SPEED_PER_TRAVEL 5.7f          /* 1/s */
#define SINE_ACCELERATION 60.0f        /* rad/s2 of a stroke */
#define SINE_SETTLE_S 0.04f
#define AXIS_WINDOW_S 0.25f
#define BLOCK_TICKS 5                  /* the sums of a block are demodulated in the next ticks, one sine in each */
#define LOAD_TICK 4                    /* tick of a block that reads the load */
#define MIN_SHARE 0.1f                 /* least speed of a sine over that of its reference */
#define MAX_FACTOR 5.0f                /* of the inertia over that of the configuration */
#define MAX_DELAY_INERTIA 2.0f         /* over that of the slowest sine */
#define MAX_TANGENT 1.2f               /* of the phase less the guess */
#define MAX_GUESS_RAD 1.3f
#define SAMPLING_ERROR (1.0f / 12)     /* of the inertia, over (w period)^2: torque and speed are means over a tick */
#define LAG_ERROR (1.0f / 16)          /* added for a current lag of up to half a tick; also its interval */
#define INERTIA_ERROR 0.006f           /* of the inertia, at each sine */
#define ELASTIC_ERROR 0.005f           /* added if the axis is elastic */
#define COUNT_ERROR 0.018f             /* added for each count of noise, over the amplitude of the sine */
#define SOFTEST_OVER_SINE 1.15f        /* the load rings at least at this multiple of the slowest sine */
#define ROTOR_SHARE 0.93f              /* of the bound: damping of the shaft, and friction on its load */
#define STIFFEST_HZ 200.0f             /* resonance of the stiffest shaft of an elastic axis */
#define HIDDEN_HZ 160.0f               /* the same if the sines show no shaft */
#define FASTER_HIDDEN_HZ 130.0f        /* the same with faster sines, which hardly hide one */
#define SHAFT_STEP 1.03f               /* from one w^2 of a shaft to the next */
#define FINE_STEP 1.01f                /* the same, with faster sines */
#define SLOW_SHARE 0.42f               /* of the mean speed: a low-passed speed above it does not reverse */
#define WEAKER 0.97f                   /* factor of the sines in a tick in which the axis is slower */
#define FASTER_PERIOD_S 1.25e-3f       /* longest period for the faster sines: the blocks must be shorter than half of a turn */
#define FASTEST_PERIOD_S 1.08e-3f      /* the same for the last set */
#define LIGHT_SHARE 0.98f              /* of the inertia that the compensator needs: for rounding */
#define DIRECTION_S 1e-3f              /* time over which the counts show the direction */
#define MAX_REVERSED 0.05f             /* of the windows: beyond it the inertia is false, by up to a factor of 2.5 */
#define LOUD_SPEED_SHARE 0.6f          /* of the speed limit: beyond it a resonance is near, and the sines stop */
#define DELAY_ERROR_TICKS 0.05f        /* the error of the fastest sine comes on top */
#define ELASTIC_DELAY_ERROR_TICKS 0.1f /* added if the axis is elastic */

enum { SINES = DAHL_COMMISSION_SINES, SLOWER = 1, FASTER = 2, SETS = 4, NONE = SINES };

/** Steps of the evaluation, each by its first tick. Most take a tick for each sine. */
enum {
    FIND_INERTIA = 0,
    FIND_DIFFERENCE = SINES,
    FIND_ERROR = 2 * SINES,
    FIND_SLOPE_ERROR = 3 * SINES, /* this one and the next two take one tick */
    FIND_ELASTIC = 3 * SINES + 1,
    FIND_DELAY = 3 * SINES + 2,
    SUBTRACT_FRICTION = 4 * SINES,
    START_SEARCH = 5 * SINES
};

/** Periods of the sines in a window: 16, 28, 44 Hz; slower 12, 20, 28 Hz; faster 16, 52, 76 Hz, and if the rotor or its load is
 * near one of them 16, 68, 88 Hz. */
static const uint8_t periods[SETS][SINES] = {{4, 7, 11}, {3, 5, 7}, {4, 13, 19}, {4, 17, 22}};
/** Shares of the sines: at first, and the least. With a smaller one, the slow sines do not show a shaft with a soft loop. */
static const float largest_shares[SETS] = {1, 1, 0.65f, 0.65f}, least_shares[SETS] = {0.55f, 0.55f, 0.2f, 0.2f};
static const float sine_shares[SINES] = {0.2f, 0.12f, 0.12f}; /* speed of the sines over the mean speed */

/* Weights of the sines in Q13 of these shares: speed, angle (over the periods), acceleration (times the periods). */
#define Q13(x) (int32_t)((x) * 8192.0f + 0.5f)
static const int32_t speed_weights[SINES] = {Q13(0.2f), Q13(0.12f), Q13(0.12f)};
static const int32_t angle_weights[SETS][SINES] = {{Q13(0.2f / 4), Q13(0.12f / 7), Q13(0.12f / 11)},
                                                   {Q13(0.2f / 3), Q13(0.12f / 5), Q13(0.12f / 7)},
                                                   {Q13(0.2f / 4), Q13(0.12f / 13), Q13(0.12f / 19)},
                                                   {Q13(0.2f / 4), Q13(0.12f / 17), Q13(0.12f / 22)}};
static const int32_t acceleration_weights[SETS][SINES] = {{Q13(0.2f * 4), Q13(0.12f * 7), Q13(0.12f * 11)},
                                                          {Q13(0.2f * 3), Q13(0.12f * 5), Q13(0.12f * 7)},
                                                          {Q13(0.2f * 4), Q13(0.12f * 13), Q13(0.12f * 19)},
                                                          {Q13(0.2f * 4), Q13(0.12f * 17), Q13(0.12f * 22)}};

/** Return the sine of a phase in Q15, within 1.2e-4. A turn is 2^32. */
static int32_t sine_q15(uint32_t phase)
{
    int32_t x = (int32_t)(phase >> 16);
    x = x < 16384 ? x : x < 49152 ? 32768 - x : x - 65536; /* Q14 of a quarter of a turn */
    const int32_t square = x * x / 16384;
    return x * (25733 - square * (10539 - square * 1191 / 16384) / 16384) / 8192;
}

static int32_t cosine_q15(uint32_t phase)
{
    return sine_q15(phase + 0x40000000u);
}

static void start_motion(dahl_commission_t *axis)
{
    const uint32_t ticks = dahl_ticks(axis, AXIS_WINDOW_S);
    const float slowest = AXIS_TWO_PI / ((float)ticks * axis->config.period);
    for (int k = 0; k < SINES; k++) {
        const uint8_t turns = periods[axis->work.inertia.set][k];
        axis->work.inertia.phase[k] = 0;
        axis->work.inertia.turn[k] = UINT32_MAX / ticks * turns;
        axis->work.inertia.frequency[k] = slowest * (float)turns;
        for (int half = 0; half < 2; half++) {
            for (int part = 0; part < 2; part++) {
                axis->work.inertia.torque[half][k][part] = 0;
                axis->work.inertia.speed[half][k][part] = 0;
            }
        }
    }
    axis->work.inertia.slowest = slowest;
    axis->work.inertia.window_ticks = ticks;
    axis->work.inertia.settle_ticks = dahl_ticks(axis, SINE_SETTLE_S);
    axis->work.inertia.direction_ticks = dahl_ticks(axis, DIRECTION_S);
    axis->work.inertia.moved_ticks = axis->work.inertia.reversed_ticks = 0;
    axis->work.inertia.moved_counts = 0;
    axis->work.inertia.stroke = 0;
    axis->work.inertia.mean_speed = dahl_smaller(MEAN_SPEED, SPEED_PER_TRAVEL * axis->config.travel);
    axis->work.inertia.share = largest_shares[axis->work.inertia.set];
    axis->work.inertia.sine = NONE;
    axis->work.inertia.base = axis->command;
    dahl_next_step(axis);
}

static void start_block(dahl_commission_t *axis)
{
    axis->work.inertia.block_ticks = 0;
    axis->work.inertia.block_counts = axis->work.inertia.fall_counts = 0;
    axis->work.inertia.block_torque = axis->work.inertia.fall_torque = 0;
}

/** Start the next stroke of the base motion. The last one goes to the middle. */
static void next_stroke(dahl_commission_t *axis)
{
    uint8_t stroke = ++axis->work.inertia.stroke;
    float end = stroke & 1 ? axis->config.travel : -axis->config.travel;
    dahl_stroke_to(axis, stroke > SINE_STROKES ? 0 : end, axis->work.inertia.mean_speed, SINE_ACCELERATION);
    axis->work.inertia.window = 0;
    start_block(axis);
}

/** Return 1 in the ticks of a stroke in which the axis moves at constant speed. */
static int is_cruise(const dahl_commission_t *axis)
{
    const uint32_t tick = axis->stroke.tick, ramp = axis->stroke.ramp_ticks;
    return tick > ramp + axis->work.inertia.settle_ticks && tick < ramp + axis->stroke.cruise_ticks;
}

/** Return the share of the sines, 0 to 1. It rises in the first stroke and falls in the last one. A loop that amplifies the
 * sines must not reverse the axis, because friction then changes its sign. */
static float envelope(dahl_commission_t *axis)
{
    const uint8_t stroke = axis->work.inertia.stroke;
    const float along = axis->stroke.speed < 0 ? -axis->speed : axis->speed;
    if (is_cruise(axis) && along < SLOW_SHARE * axis->work.inertia.mean_speed) {
        axis->work.inertia.share = dahl_larger(least_shares[axis->work.inertia.set], WEAKER * axis->work.inertia.share);
    }
    if (stroke > 1 && stroke <= SINE_STROKES) {
        return axis->work.inertia.share;
    }
    float part = (float)axis->stroke.tick / (float)(2 * axis->stroke.ramp_ticks + axis->stroke.cruise_ticks);
    return (stroke == 1 ? part : 1 - part) * axis->work.inertia.share;
}

/** Add the sines to the base motion. */
static void add_sines(dahl_commission_t *axis)
{
    const float speed = envelope(axis) * axis->work.inertia.mean_speed * 0x1p-28f, slowest = axis->work.inertia.slowest;
    const uint8_t set = axis->work.inertia.set;
    int32_t angles = 0, speeds = 0, accelerations = 0;
    for (int k = 0; k < SINES; k++) {
        axis->work.inertia.phase[k] += axis->work.inertia.turn[k];
        const int32_t sine = sine_q15(axis->work.inertia.phase[k]);
        angles += angle_weights[set][k] * sine;
        speeds += speed_weights[k] * cosine_q15(axis->work.inertia.phase[k]);
        accelerations -= acceleration_weights[set][k] * sine;
    }
    axis->command.angle += speed / slowest * (float)angles;
    axis->command.speed += speed * (float)speeds;
    axis->command.acceleration += speed * slowest * (float)accelerations;
}

/** Demodulate the last block at one sine. All sines have a fixed phase to the block, which cancels in torque over speed. */
static void demodulate(dahl_commission_t *axis)
{
    const uint8_t k = axis->work.inertia.sine++, half = axis->work.inertia.stroke > 1 + SINE_STROKES / 2;
    const int32_t along = cosine_q15(axis->work.inertia.phase[k]), across = sine_q15(axis->work.inertia.phase[k]);
    const float sine = (float)across * 0x1p-15f, cosine = (float)along * 0x1p-15f;
    float *torque = axis->work.inertia.torque[half][k], *speed = axis->work.inertia.speed[half][k];
    torque[0] += axis->work.inertia.last_torque * cosine;
    torque[1] -= axis->work.inertia.last_torque * sine;
    speed[0] += axis->work.inertia.last_speed * cosine;
    speed[1] -= axis->work.inertia.last_speed * sine;
}

/** End a block. Torque and counts of two neighbouring blocks have the weights 1 to BLOCK_TICKS and back, so that the noise of
 * the counts averages out. The load and the speed of the base motion are subtracted, and the window multiplies them. */
static void finish_block(dahl_commission_t *axis)
{
    const float weights = (BLOCK_TICKS + 1) * BLOCK_TICKS / 2.0f, load = weights * axis->work.inertia.block_load;
    const int32_t counts = axis->work.inertia.rise_counts + axis->work.inertia.fall_counts;
    const float torque = axis->work.inertia.rise_torque + axis->work.inertia.fall_torque - load;
    const float speed = (float)counts * axis->config.theta_per_count / axis->config.period;
    const int32_t cosine = cosine_q15(axis->work.inertia.window);
    const float weight = (1 - (float)cosine * 0x1p-15f) / (BLOCK_TICKS + 1);
    if (axis->work.inertia.window != 0) {
        axis->work.inertia.last_torque = weight * torque;
        axis->work.inertia.last_speed = weight * (speed - 2 * weights * axis->work.inertia.base.speed);
        axis->work.inertia.sine = 0;
    }
    axis->work.inertia.rise_counts = (BLOCK_TICKS + 1) * axis->work.inertia.block_counts - axis->work.inertia.fall_counts;
    axis->work.inertia.rise_torque =
        (BLOCK_TICKS + 1) * axis->work.inertia.block_torque - axis->work.inertia.fall_torque - load;
    axis->work.inertia.window += UINT32_MAX / axis->work.inertia.window_ticks * BLOCK_TICKS;
    start_block(axis);
}

/** Count the ticks in which the axis moves backward by more than the noise. */
static void count_reversals(dahl_commission_t *axis, int32_t dcounts)
{
    axis->work.inertia.moved_counts += axis->stroke.speed < 0 ? -dcounts : dcounts;
    if (++axis->work.inertia.moved_ticks < axis->work.inertia.direction_ticks) {
        return;
    }
    if (axis->work.inertia.moved_counts < -(int32_t)axis->result.noise) {
        axis->work.inertia.reversed_ticks += axis->work.inertia.moved_ticks;
    }
    axis->work.inertia.moved_ticks = 0;
    axis->work.inertia.moved_counts = 0;
}

/** Return 1 if the loop shakes the axis backward in the strokes. Friction then is no constant and passes for inertia. */
static int is_shaken(const dahl_commission_t *axis)
{
    const float ticks = (SINE_STROKES - 1) * (float)axis->work.inertia.window_ticks;
    return (float)axis->work.inertia.reversed_ticks > MAX_REVERSED * ticks;
}

/** Sum torque and counts over a block of ticks. The sines of the block before follow in its first ticks, one in each. */
static void add_to_block(dahl_commission_t *axis, int32_t dcounts)
{
    const uint32_t first = axis->stroke.ramp_ticks + axis->work.inertia.settle_ticks;
    const uint32_t tick = axis->stroke.tick, stroke = axis->work.inertia.stroke;
    if (axis->work.inertia.sine < SINES) {
        demodulate(axis);
    }
    if (stroke < 2 || stroke > SINE_STROKES || tick < first || tick >= first + axis->work.inertia.window_ticks) {
        return;
    }
    count_reversals(axis, dcounts);
    axis->work.inertia.block_torque += axis->torque;
    axis->work.inertia.fall_torque += axis->work.inertia.block_torque;
    axis->work.inertia.block_counts += dcounts;
    axis->work.inertia.fall_counts += axis->work.inertia.block_counts;
    axis->work.inertia.block_ticks++;
    if (axis->work.inertia.block_ticks == LOAD_TICK) {
        axis->work.inertia.block_load = dahl_commission_load(axis, axis->theta);
    } else if (axis->work.inertia.block_ticks == BLOCK_TICKS) {
        finish_block(axis);
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
    least *= axis->work.inertia.mean_speed * (float)axis->work.inertia.window_ticks;
    if (!(square > least * least)) {
        return 0;
    }
    ratio[0] = (torque[1] * speed[0] - torque[0] * speed[1]) / square;
    ratio[1] = -(torque[0] * speed[0] + torque[1] * speed[1]) / square;
    return 1;
}

/** Return 1 if slower sines have shown the inertia and the delay, and the strokes are repeated for the bound only. */
static int is_repeated(const dahl_commission_t *axis)
{
    return axis->work.inertia.is_repeated;
}

/** Return the least amplitude of a sine, in both halves of the strokes together. */
static float least_speed(int k)
{
    return MIN_SHARE * sine_shares[k] * (SINE_STROKES - 1) / 2;
}

/** Write the inertia that the sine shows, and its phase near `guess`. The inertia is negative if the load swings against the
 * rotor. Return 0 if the sine did not move the axis, or if its phase is too large. */
static int find_inertia(dahl_commission_t *axis, int k, float guess)
{
    const float w = axis->work.inertia.frequency[k];
    float all[2], turn[2], torque[2], speed[2];
    for (int part = 0; part < 2; part++) {
        torque[part] = axis->work.inertia.torque[0][k][part] + axis->work.inertia.torque[1][k][part];
        speed[part] = axis->work.inertia.speed[0][k][part] + axis->work.inertia.speed[1][k][part];
    }
    if (!find_ratio(axis, torque, speed, least_speed(k), all)) {
        return 0;
    }
    dahl_small_turn(guess, turn);
    float along = all[0] * turn[0] + all[1] * turn[1], across = all[1] * turn[0] - all[0] * turn[1];
    float size = dahl_root(all[0] * all[0] + all[1] * all[1]);
    const float sampling = 1 - (SAMPLING_ERROR + LAG_ERROR) * w * w * axis->config.period * axis->config.period;
    axis->work.inertia.inertia[k] = (along < 0 ? -size : size) * sampling / w;
    axis->work.inertia.lag[k] = guess + angle_of(across / along);
    return dahl_absolute(across) < MAX_TANGENT * dahl_absolute(along);
}

/** Write the difference of the inertias in both halves of the strokes. Return 0 if the sine did not move the axis. */
static int find_difference(dahl_commission_t *axis, int k)
{
    float half[2][2], turn[2];
    for (int h = 0; h < 2; h++) {
        if (!find_ratio(axis, axis->work.inertia.torque[h][k], axis->work.inertia.speed[h][k], least_speed(k) / 4, half[h])) {
            return 0;
        }
    }
    dahl_small_turn(axis->work.inertia.lag[k], turn);
    float difference = (half[1][0] - half[0][0]) * turn[0] + (half[1][1] - half[0][1]) * turn[1];
    axis->work.inertia.difference[k] = dahl_absolute(difference) / (2 * axis->work.inertia.frequency[k]);
    return 1;
}

/** Return the error that a current lag of up to half a tick makes in the inertia at a sine. Its sign is that of all sines. */
static float lag_error(const dahl_commission_t *axis, int k)
{
    const float turn = axis->work.inertia.frequency[k] * axis->config.period;
    return LAG_ERROR * turn * turn * axis->work.inertia.inertia[0];
}

/** Return the error of the inertia at a sine that does not depend on the errors of the other sines. */
static float own_error(const dahl_commission_t *axis, int k)
{
    const float speed = sine_shares[k] * axis->work.inertia.share * axis->work.inertia.mean_speed;
    const float amplitude = speed / axis->work.inertia.frequency[k];
    const float counts = (float)(axis->result.noise + 1) * axis->config.theta_per_count / amplitude;
    const float *inertia = axis->work.inertia.inertia;
    const float least = axis->work.inertia.set < FASTER ? inertia[0] : axis->config.inertia / 3;
    return (INERTIA_ERROR + COUNT_ERROR * counts) * dahl_larger(least, dahl_absolute(inertia[k]))
           + axis->work.inertia.difference[k];
}

/** Write the error of the difference of the first inertia and the last one. The lag moves both. */
static void find_slope_error(dahl_commission_t *axis)
{
    const float *error = axis->work.inertia.error, lag0 = lag_error(axis, 0), lag2 = lag_error(axis, 2);
    const float own0 = error[0] - lag0, own2 = error[2] - lag2;
    axis->work.inertia.slope_error = dahl_root(own0 * own0 + own2 * own2) + lag2 - lag0;
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

/** Return 1 if a sine shows the delay of an elastic axis: near the frequency of the load, the rotor hardly moves. */
static int shows_delay(const dahl_commission_t *axis, int k)
{
    const float *inertia = axis->work.inertia.inertia;
    return inertia[k] > 0 && inertia[k] < MAX_DELAY_INERTIA * inertia[0];
}

/** Write the delay of an elastic axis. The damping of its shaft looks like viscous friction that grows with the frequency, so
 * the delay comes from one sine at a time. Damping makes it shorter. Return its error. */
static float find_elastic_delay(const dahl_commission_t *axis, float *delay)
{
    const float *inertia = axis->work.inertia.inertia;
    float error = 0;
    *delay = 0;
    for (int k = shows_delay(axis, 1) ? 1 : 0; k < SINES; k++) {
        const float w = axis->work.inertia.frequency[k];
        if (shows_delay(axis, k)) {
            *delay = dahl_larger(*delay, (axis->work.inertia.lag[k] + axis->result.viscous.best / (w * inertia[k])) / w);
            error = dahl_larger(error, axis->work.inertia.error[k] / (w * inertia[k]));
        }
    }
    return error;
}

/** Return the inertia that a sine shows without the viscous friction, which has the phase that the delay leaves. */
static float inertia_without_friction(const dahl_commission_t *axis, int k, float delay)
{
    float turn[2];
    dahl_small_turn(dahl_axis_clamp(axis->work.inertia.lag[k] - axis->work.inertia.frequency[k] * delay, 1), turn);
    return axis->work.inertia.inertia[k] * turn[0];
}

/** Write the delay of a rigid axis, and whether the axis is elastic. */
static void find_elastic(dahl_commission_t *axis)
{
    const float w0 = axis->work.inertia.frequency[0], w2 = axis->work.inertia.frequency[2];
    const float *lag = axis->work.inertia.lag, *error = axis->work.inertia.error;
    const float delay = is_repeated(axis) ? axis->result.delay.best : (w2 * lag[2] - w0 * lag[0]) / (w2 * w2 - w0 * w0);
    const float slow = inertia_without_friction(axis, 0, delay), fast = inertia_without_friction(axis, 2, delay);
    axis->result.delay.best = delay;
    const int is_elastic = dahl_absolute(fast - slow) > error[2] + error[0] / 2 || axis->work.inertia.set == SLOWER;
    axis->has_soft_shaft = axis->work.inertia.set >= FASTER;
    axis->result.elastic = axis->result.elastic || is_elastic || (axis->has_soft_shaft && !is_repeated(axis));
}

/** Write the delay with its interval. It stays if the sines are repeated only to find a shaft. */
static void find_delay(dahl_commission_t *axis)
{
    if (axis->result.elastic) {
        widen_errors(axis);
    }
    if (is_repeated(axis)) {
        return;
    }
    const float period = axis->config.period;
    float delay = axis->result.delay.best;
    float error = axis->work.inertia.error[2] / (axis->work.inertia.inertia[0] * axis->work.inertia.frequency[2]);
    error += DELAY_ERROR_TICKS * period;
    if (axis->result.elastic) {
        error = find_elastic_delay(axis, &delay) + (DELAY_ERROR_TICKS + ELASTIC_DELAY_ERROR_TICKS) * period;
    }
    delay = dahl_larger(0.1f * period, delay);
    axis->result.delay = (dahl_commission_range_t){dahl_larger(0, delay - error), delay, delay + error};
}

/** Start the search of the shaft. */
static void start_search(dahl_commission_t *axis)
{
    const float least = axis->work.inertia.inertia[0], w = SOFTEST_OVER_SINE * axis->work.inertia.frequency[0];
    const float hidden = axis->work.inertia.set < FASTER ? HIDDEN_HZ : FASTER_HIDDEN_HZ;
    const float stiffest = AXIS_TWO_PI * (axis->result.elastic ? STIFFEST_HZ : hidden);
    axis->result.inertia = (dahl_commission_range_t){least, least, least};
    axis->work.inertia.gap = least;
    axis->work.inertia.shaft = w * w;
    axis->work.inertia.stiffest = stiffest * stiffest;
}

/** Take a shaft on which the load alone rings at w^2 = a. Return 1 if it explains the three sines within their errors. */
static int is_shaft(dahl_commission_t *axis, float a)
{
    const float *inertia = axis->work.inertia.inertia, *error = axis->work.inertia.error;
    float *u = axis->work.inertia.stiff;
    for (int k = 0; k < SINES; k++) {
        float w = axis->work.inertia.frequency[k];
        u[k] = a / (a - w * w);
    }
    const float part = (u[1] - u[0]) / (u[2] - u[0]);
    axis->work.inertia.misfit = dahl_absolute(inertia[0] + part * (inertia[2] - inertia[0]) - inertia[1]);
    return axis->work.inertia.misfit <= error[1] + dahl_absolute(part) * error[2] + dahl_absolute(1 - part) * error[0];
}

/** Widen the result by the shaft of is_shaft(). */
static void widen_result(dahl_commission_t *axis, float a)
{
    const float *inertia = axis->work.inertia.inertia, *u = axis->work.inertia.stiff, all = u[2] - u[0];
    dahl_commission_range_t *result = &axis->result.inertia;
    const float load = (inertia[2] - inertia[0]) / all, error = axis->work.inertia.slope_error / dahl_absolute(all);
    const float total = inertia[0] - load * (u[0] - 1);
    float least = inertia[0] - (dahl_absolute(load) + error) * u[0];
    for (int k = 1; k < SINES; k++) { /* above the frequency of the load, it swings against the rotor */
        least = u[k] < 0 ? dahl_larger(least, inertia[k] - axis->work.inertia.error[k]) : least;
    }
    result->least = dahl_smaller(result->least, dahl_larger(least, total * a / axis->work.inertia.stiffest));
    result->most = dahl_larger(result->most, total);
    if (axis->work.inertia.misfit < axis->work.inertia.gap) {
        axis->work.inertia.gap = axis->work.inertia.misfit;
        result->best = total;
    }
}

/** Repeat the stage with other sines. Refuse if there are none. */
static void try_next(dahl_commission_t *axis)
{
    const float period = axis->config.period;
    const int sets = period > FASTER_PERIOD_S ? FASTER : period > FASTEST_PERIOD_S ? FASTER + 1 : SETS;
    if (++axis->work.inertia.set < sets) {
        dahl_return_to_middle(axis);
    } else {
        dahl_refuse(axis, is_repeated(axis) ? DAHL_COMMISSION_LIGHT : DAHL_COMMISSION_BAD_INERTIA);
    }
}

/** Return 1 if the bound of the rotor is too low for the compensator. Faster sines may raise it. */
static int is_light(const dahl_commission_t *axis)
{
    const float late = axis->result.delay.most + axis->config.period / 2;
    return axis->result.sigma0.most * late * late > LIGHT_SHARE * 3 * axis->result.inertia.least;
}

/** After the strokes, evaluate one step in each tick, then one shaft. */
static void start_evaluation(dahl_commission_t *axis)
{
    axis->work.inertia.evaluated = 0;
    axis->work.inertia.shaft = 0;
    dahl_next_step(axis);
    axis->command.mode = DAHL_COMMISSION_TORQUE;
    axis->command.torque = dahl_commission_load(axis, axis->theta);
}

/** Evaluate the strokes. If the loop shook the axis, they show nothing. */
static void end_strokes(dahl_commission_t *axis)
{
    if (is_shaken(axis)) {
        dahl_refuse(axis, DAHL_COMMISSION_VARIES);
        return;
    }
    start_evaluation(axis);
}

/** Evaluate a sine. Its phase is near that of the first one, scaled by the frequency. */
static void evaluate_sine(dahl_commission_t *axis, int k)
{
    const float *frequency = axis->work.inertia.frequency;
    const float delay = is_repeated(axis) ? axis->result.delay.best : k == 0 ? 0 : axis->work.inertia.lag[0] / frequency[0];
    const float guess = dahl_smaller(MAX_GUESS_RAD, delay * frequency[k]);
    if (!find_inertia(axis, k, guess) || !(axis->work.inertia.inertia[0] > 0)) {
        try_next(axis);
    }
}

/** Compare both halves of the strokes at a sine. */
static void compare_strokes(dahl_commission_t *axis, int k)
{
    if (!find_difference(axis, k)) {
        try_next(axis);
    }
}

/** Evaluate one step in each tick. */
static void evaluate_step(dahl_commission_t *axis)
{
    const int step = axis->work.inertia.evaluated++, k = step % SINES;
    if (step < FIND_DIFFERENCE) {
        evaluate_sine(axis, k);
    } else if (step < FIND_ERROR) {
        compare_strokes(axis, k);
    } else if (step < FIND_SLOPE_ERROR) {
        axis->work.inertia.error[k] = own_error(axis, k) + lag_error(axis, k);
    } else if (step == FIND_SLOPE_ERROR) {
        find_slope_error(axis);
    } else if (step == FIND_ELASTIC) {
        find_elastic(axis);
    } else if (step == FIND_DELAY) {
        find_delay(axis);
    } else if (step < START_SEARCH) {
        axis->work.inertia.inertia[k] = inertia_without_friction(axis, k, axis->result.delay.best);
    } else {
        start_search(axis);
    }
}

/** Leave the stage, or repeat it with slower sines. */
static void finish_search(dahl_commission_t *axis)
{
    dahl_commission_range_t *result = &axis->result.inertia;
    float ratio = result->best / axis->config.inertia, error = axis->work.inertia.error[1] + INERTIA_ERROR * result->best;
    if (!(ratio > 1 / MAX_FACTOR && ratio < MAX_FACTOR && axis->work.inertia.gap < axis->work.inertia.inertia[0])) {
        try_next(axis);
        return;
    }
    if (!axis->result.elastic) {
        result->best = (axis->work.inertia.inertia[0] + axis->work.inertia.inertia[1]) / 2;
    }
    result->least = dahl_smaller((axis->result.elastic ? ROTOR_SHARE : 1) * result->least, result->best - error);
    result->most = dahl_larger(result->most, result->best + error);
    if (is_light(axis) && axis->work.inertia.set < FASTER && axis->config.period <= FASTER_PERIOD_S) {
        axis->work.inertia.set = FASTER;
        axis->work.inertia.is_repeated = 1;
    } else {
        dahl_enter(axis, DAHL_COMMISSION_KICK);
    }
    dahl_return_to_middle(axis);
}

/** Try a shaft. If it explains the sines, widen the result in the next tick. */
static void search_tick(dahl_commission_t *axis)
{
    const float shaft = axis->work.inertia.shaft;
    if (axis->work.inertia.is_shaft) {
        widen_result(axis, shaft);
    } else if (!(shaft < axis->work.inertia.stiffest)) {
        finish_search(axis);
        return;
    } else if (is_shaft(axis, shaft)) {
        axis->work.inertia.is_shaft = 1;
        return;
    }
    axis->work.inertia.is_shaft = 0;
    axis->work.inertia.shaft = shaft * (axis->work.inertia.set < FASTER ? SHAFT_STEP : FINE_STEP);
}

static void shaft_tick(dahl_commission_t *axis)
{
    if (axis->work.inertia.shaft > 0) {
        search_tick(axis);
    } else {
        evaluate_step(axis);
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
        try_next(axis);
        return;
    }
    add_to_block(axis, dcounts);
    axis->command.angle = axis->work.inertia.base.angle;
    axis->command.speed = axis->work.inertia.base.speed;
    int is_end = dahl_stroke_tick(axis);
    if (is_end && axis->work.inertia.stroke > SINE_STROKES) {
        end_strokes(axis);
        return;
    }
    if (is_end) {
        next_stroke(axis);
    }
    axis->work.inertia.base = axis->command;
    add_sines(axis);
}

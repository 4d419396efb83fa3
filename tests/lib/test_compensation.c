/* SPDX-License-Identifier: MIT */
/* The measured law on a simulated axis: it comes to rest after a kick, no path of the shaft gains energy, and bad readings do not
 * turn its torque. Each limit has a case outside the promise that must miss it. The numbers are those of docs/compensation.md;
 * test_compensation_scene.py has position loops.
 *
 * The axis is in double precision: rotor, true friction, encoder with noise, delay of the drive. The library does not
 * integrate the true friction. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "../random.h"
#include "dahl_compensator.h"
#include "dahl_encoder.h"

#define TWO_PI 6.283185307179586
#define TRUE_FC 0.5       /* N m */
#define TRUE_SIGMA0 100.0 /* N m/rad: a presliding length of 5 mrad */
#define SUBSTEP_S 62.5e-6

static const double rates_hz[] = {1000, 8000};

static void at_most(double limit, double value)
{
    char message[64];
    snprintf(message, sizeof message, "%g is above %g", value, limit);
    TEST_ASSERT_TRUE_MESSAGE(value <= limit, message);
}

static void at_least(double limit, double value)
{
    char message[64];
    snprintf(message, sizeof message, "%g is below %g", value, limit);
    TEST_ASSERT_TRUE_MESSAGE(value >= limit, message);
}

/* --- the axis -------------------------------------------------------------------------------------------------------- */

/* Dahl's model. With a stribeck_speed it is LuGre's without damping: Fc rises towards rest to the breakaway torque. If is_slip,
 * a spring that slips: it loses no energy in presliding. */
typedef struct {
    double Fc, sigma0, F;
    int is_slip;
    double breakaway, stribeck_speed; /* N m, rad/s */
} friction_t;

static double friction_limit(const friction_t *f, double speed)
{
    if (f->stribeck_speed <= 0) {
        return f->Fc;
    }
    const double ratio = speed / f->stribeck_speed;
    return f->Fc + (f->breakaway - f->Fc) * exp(-ratio * ratio);
}

/* The integral over a step is exact. Return the work done against the friction. */
static double friction_move(friction_t *f, double dtheta, double speed)
{
    const double sign = dtheta < 0 ? -1 : 1, Fc = friction_limit(f, speed);
    if (f->is_slip) {
        f->F = fmax(-Fc, fmin(Fc, f->F + f->sigma0 * dtheta));
        return f->F * dtheta;
    }
    const double gap = sign * Fc - f->F, closed = -gap * expm1(-f->sigma0 / Fc * fabs(dtheta));
    f->F += closed;
    return sign * Fc * dtheta - sign * closed * Fc / f->sigma0;
}

/* Wrong readings: reported and passed to dahl_encoder_move(), reported and not stored, reported with a move of 0, or not reported
 * and longer than the jump. */
typedef enum { REPORTED, NOT_STORED, SKIPPED, JUMP, FAULTS } fault_t;

typedef struct {
    friction_t friction;
    double inertia, theta, speed; /* kg m2, rad, rad/s */
    double period, theta_per_count;
    int noise, delay; /* counts, ticks */
    int is_noise_after_rounding, is_bad; /* is_bad: the firmware reports a bad reading */
    fault_t fault;
    double fault_share; /* of the ticks */
    int is_wrong;       /* the last reading */
    uint64_t random;
    dahl_encoder_t encoder;
    double commands[4]; /* N m, the newest first */
    double torque;      /* N m, of the compensator */
    dahl_compensator_params_t params;
    dahl_compensator_plan_t plan;
    dahl_compensator_t compensator;
    dahl_plan_t element;
    dahl_state_t bristle;
} axis_t;

/* An axis whose compensator knows the true friction. */
static axis_t axis_of(int bits, double rate_hz)
{
    axis_t axis;
    memset(&axis, 0, sizeof axis);
    axis.friction = (friction_t){.Fc = TRUE_FC, .sigma0 = TRUE_SIGMA0};
    axis.inertia = 0.002;
    axis.period = 1 / rate_hz;
    axis.theta_per_count = TWO_PI / (1 << bits);
    axis.delay = 1;
    axis.random = 1;
    axis.params = (dahl_compensator_params_t){
        .friction = {(float)TRUE_SIGMA0, (float)TRUE_FC, (float)axis.theta_per_count},
        .law = DAHL_COMPENSATOR_MEASURED,
        .Fc_low = (float)TRUE_FC,
        .length_long = (float)(TRUE_FC / TRUE_SIGMA0),
        .sigma0_high = (float)TRUE_SIGMA0,
        .gain = 0.9f,
        .limit = 1.0f,
        .slew = 50.0f,
        .period = (float)axis.period,
        .fall = 0.02f,
        .play = 1,
        .jump = 1u << 30,
    };
    return axis;
}

/* With noise of `noise` counts, and a play of 2 noise + more_play. */
static axis_t noisy_axis(int bits, double rate_hz, int noise, int more_play)
{
    axis_t axis = axis_of(bits, rate_hz);
    axis.noise = noise;
    axis.params.noise = (uint32_t)noise;
    axis.params.play = (uint32_t)(2 * noise + more_play);
    return axis;
}

/* Bounds that follow the parameters of the element, so that prepare accepts any of them. */
static void claim(axis_t *axis, double Fc, double sigma0)
{
    axis->params.friction.Fc = (float)Fc;
    axis->params.friction.sigma0 = (float)sigma0;
    axis->params.Fc_low = axis->params.friction.Fc / 0.949f; /* for gain 1 */
    axis->params.length_long = 0.999f * axis->params.friction.Fc / axis->params.friction.sigma0;
}

static void start(axis_t *axis)
{
    axis->params.inertia = (float)axis->inertia;
    axis->params.delay = (float)(axis->delay * axis->period);
    const uint32_t turn = (uint32_t)lround(TWO_PI / axis->theta_per_count);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_encoder_init(&axis->encoder, turn, +1, 0));
    dahl_encoder_home(&axis->encoder, 0);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_prepare(&axis->element, &axis->params.friction));
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_compensator_prepare(&axis->plan, &axis->params));
}

/* The noise is uniform in +-noise: of whole counts if it is added after the quantization. */
static int32_t read_counts(axis_t *axis)
{
    const uint32_t random = random_u32(&axis->random);
    const double counts = axis->theta / axis->theta_per_count;
    if (axis->is_noise_after_rounding) {
        return (int32_t)floor(counts) + (int32_t)(random % (2 * (uint32_t)axis->noise + 1)) - axis->noise;
    }
    return (int32_t)floor(counts + axis->noise * (random * 0x1p-31 - 1));
}

/* Return the error of a wrong reading in counts. Jumps change their sign, so that two in a row do not cancel. */
static int32_t wrong_counts(axis_t *axis)
{
    const int32_t random = (int32_t)(random_u32(&axis->random) & 0xffffu);
    return axis->fault == JUMP ? (random & 1 ? 1 : -1) * (int32_t)(2 * axis->params.jump) : random % 301 - 150;
}

/* Return the move of a tick. */
static int32_t read_encoder(axis_t *axis)
{
    int32_t counts = read_counts(axis);
    axis->is_wrong = axis->fault_share > 0 && random_u32(&axis->random) * 0x1p-32 < axis->fault_share;
    if (axis->fault_share > 0) {
        axis->is_bad = axis->is_wrong && axis->fault != JUMP;
        counts += axis->is_wrong ? wrong_counts(axis) : 0;
    }
    const uint32_t modulus = axis->encoder.modulus, reading = (uint32_t)counts % modulus;
    if (axis->is_bad && axis->fault != REPORTED) {
        return axis->fault == SKIPPED ? 0 : dahl_counts_between(axis->encoder.last, reading, modulus);
    }
    return dahl_encoder_move(&axis->encoder, reading);
}

static double compensate(axis_t *axis, int32_t dcounts)
{
    const int32_t move = dahl_compensator_move(&axis->plan, &axis->compensator, dcounts, !axis->is_bad);
    const int32_t ratio = dahl_step_counts_q30(&axis->element, &axis->bristle, move);
    const int32_t torque_q30 = dahl_compensator_torque(&axis->plan, &axis->compensator, ratio);
    return torque_q30 * (double)DAHL_Q30 * axis->params.friction.Fc;
}

/* Read the encoder and send a torque. Return the one of `delay` ticks ago, which acts now. */
static double drive(axis_t *axis)
{
    const int32_t dcounts = read_encoder(axis);
    memmove(&axis->commands[1], &axis->commands[0], 3 * sizeof axis->commands[0]);
    axis->commands[0] = compensate(axis, dcounts);
    return axis->commands[axis->delay];
}

static void tick(axis_t *axis, double external_torque)
{
    const double torque = drive(axis) + external_torque;
    for (int k = (int)lround(axis->period / SUBSTEP_S); k > 0; k--) {
        axis->speed += (torque - axis->friction.F) / axis->inertia * SUBSTEP_S;
        axis->theta += axis->speed * SUBSTEP_S;
        (void)friction_move(&axis->friction, axis->speed * SUBSTEP_S, axis->speed);
    }
}

/* --- rest after a kick ------------------------------------------------------------------------------------------------ */

/* Largest speed in the last of `seconds` after a kick. */
static double speed_after_kick(axis_t axis, double seconds)
{
    double largest = 0;
    start(&axis);
    axis.speed = 3;
    const int ticks = (int)lround(seconds / axis.period), last = (int)lround(1 / axis.period);
    for (int t = 0; t < ticks; t++) {
        tick(&axis, 0);
        largest = t >= ticks - last ? fmax(largest, fabs(axis.speed)) : 0;
    }
    return largest;
}

/* Of light and heavy axes with 1 to 3 ticks of delay. */
static double largest_speed_after_kick(axis_t axis)
{
    double largest = 0;
    for (axis.delay = 1; axis.delay <= 3; axis.delay++) {
        for (int kind = 0; kind < 2; kind++) {
            axis.inertia = kind == 0 ? 0.002 : 0.02;
            largest = fmax(largest, speed_after_kick(axis, 4));
        }
    }
    return largest;
}

/* Two counts more than twice the noise are the guarantee. */
static void test_a_free_axis_comes_to_rest_if_the_play_is_wide_enough(void)
{
    static const double narrow[][2] = {{0.15, 0.42}, {0.08, 0.15}, {0.04, 0.05}}; /* noise before, after the rounding */
    double largest[2] = {0, 0};
    for (int bits = 12; bits <= 20; bits += 2) {
        for (int kind = 0; kind < 8; kind++) {
            const int is_after = kind / 4;
            axis_t axis = noisy_axis(bits, rates_hz[kind % 2], 1 + kind / 2 % 2, 2);
            axis.is_noise_after_rounding = is_after;
            at_most(0.02, largest_speed_after_kick(axis));
            axis.params.play -= 2;
            const double speed = largest_speed_after_kick(axis);
            at_most(narrow[bits < 14 ? 0 : bits < 16 ? 1 : 2][is_after], speed);
            largest[is_after] = fmax(largest[is_after], speed);
        }
    }
    at_least(0.02, largest[0]);
    at_least(0.2, largest[1]);
}

/* The presliding length of such a friction is the breakaway torque over sigma0. */
static void test_a_breakaway_torque_lengthens_the_presliding(void)
{
    static const double breakaway[] = {1.3, 1.3, 2}, stribeck_speed[] = {0.1, 0.5, 0.05};
    for (int kind = 0; kind < 3; kind++) {
        axis_t axis = noisy_axis(20, 8000, 1, 2);
        axis.friction.breakaway = breakaway[kind] * TRUE_FC;
        axis.friction.stribeck_speed = stribeck_speed[kind];
        at_least(kind == 1 ? 0.1 : 0, largest_speed_after_kick(axis)); /* claims Fc/sigma0 */
        claim(&axis, TRUE_FC, TRUE_SIGMA0 / breakaway[kind]);
        at_most(0.02, largest_speed_after_kick(axis));
    }
}

/* Such an axis swings by itself. */
static void test_three_times_the_length_damps_slip_friction(void)
{
    static const double limits[] = {0.45, 0.2, 0.12, 0.06};
    for (int bits = 12; bits < 16; bits++) {
        axis_t axis = noisy_axis(bits, 1000, 1, 2);
        axis.friction.is_slip = 1;
        axis_t uncompensated = axis;
        uncompensated.params.gain = 0;
        claim(&axis, TRUE_FC, TRUE_SIGMA0 / 3);
        at_least(1, largest_speed_after_kick(uncompensated));
        at_most(limits[bits - 12], largest_speed_after_kick(axis));
    }
}

static void test_the_fade_over_speed_stops_a_runaway(void)
{
    axis_t axis = axis_of(14, 1000);
    claim(&axis, 1.3 * TRUE_FC, 1.3 * TRUE_SIGMA0);
    axis.params.gain = 1;
    axis.params.jump = 2000;
    at_least(100, speed_after_kick(axis, 10));
    axis.params.fade_speed = 1;
    at_most(2, speed_after_kick(axis, 10));
}

/* --- a shaken axis, and a hand ---------------------------------------------------------------------------------------- */

/* Largest mean speed of an axis that a torque of 10 to 160 Hz shakes after a kick, when the start of the shakes has faded. */
static double shaken_speed(double gain, int more_play, int is_reported_at_rest)
{
    double largest = 0;
    for (double hertz = 10; hertz <= 160; hertz *= 2) {
        for (double amplitude = 0.2 * TRUE_FC; amplitude < TRUE_FC; amplitude *= 2) {
            axis_t axis = noisy_axis(14, 8000, 1, more_play);
            double begin = 0;
            axis.params.gain = (float)gain;
            start(&axis);
            axis.speed = 3;
            for (int t = 0; t < 4 * 8000; t++) {
                begin = t == 2 * 8000 ? axis.theta : begin;
                axis.is_bad = t >= 4000 && is_reported_at_rest;
                tick(&axis, t < 4000 ? 0 : amplitude * sin(TWO_PI * hertz * t / 8000));
            }
            largest = fmax(largest, fabs(axis.theta - begin) / 2);
        }
    }
    return largest;
}

/* The vibration hides in the play and loosens the friction, but the torque stays. */
static void test_a_shaken_axis_creeps_unless_the_firmware_reports_rest(void)
{
    const double at_full_gain = shaken_speed(0.9, 2, 0);
    at_least(0.5, at_full_gain);
    at_most(1.3, at_full_gain);
    at_most(0.7, shaken_speed(0.9, 0, 0));
    at_most(0.1, shaken_speed(0.5, 2, 0));
    at_most(0.01, shaken_speed(0.9, 2, 1));
}

/* RMS of the hand's torque over that without compensation: a sine of 0.5 Hz and a fifth of its amplitude at 1.7 Hz. */
static double hand_ratio(axis_t axis, double amplitude)
{
    double with = 0, without = 0;
    start(&axis);
    for (int t = 0; t * axis.period < 6; t++) {
        const double s = TWO_PI * 0.5 * t * axis.period, theta = amplitude * (sin(s) + 0.2 * sin(3.4 * s));
        const double motor = drive(&axis);
        (void)friction_move(&axis.friction, theta - axis.theta, 0);
        axis.theta = theta;
        with += (axis.friction.F - motor) * (axis.friction.F - motor);
        without += axis.friction.F * axis.friction.F;
    }
    return sqrt(with / without);
}

static void test_a_hand_feels_a_wider_play_in_small_motions(void)
{
    static const double large[] = {0.13, 0.155}, small[] = {0.205, 0.435};
    for (int kind = 0; kind < 8; kind++) {
        const int is_wide = kind / 4;
        const axis_t axis = noisy_axis(14, rates_hz[kind % 2], 1 + kind / 2 % 2, 2 * is_wide);
        at_most(large[is_wide], hand_ratio(axis, 0.5));
        at_most(small[is_wide], hand_ratio(axis, 0.0025));
    }
}

/* --- bad readings ----------------------------------------------------------------------------------------------------- */

/* A shaft is led in strokes of any length and speed. */
typedef struct {
    int direction, ticks;
    double speed;              /* counts per tick */
    double known, hidden_runs; /* counts between good readings in this stroke, and their interruptions */
} stroke_t;

static void lead(axis_t *axis, stroke_t *stroke)
{
    if (stroke->ticks-- == 0) {
        stroke->direction = -stroke->direction;
        stroke->speed = 30 * pow(2, -8 * (random_u32(&axis->random) * 0x1p-32));
        stroke->ticks = (int)(random_u32(&axis->random) % 300);
        stroke->known = stroke->hidden_runs = 0;
    }
    axis->theta += stroke->direction * stroke->speed * axis->theta_per_count;
}

/* Counts after which the torque has the sign of the motion: the travel from -Fc to 0, and the play, noise and rounding of each run
 * of good readings. */
static double counts_to_turn(const axis_t *axis, const stroke_t *stroke)
{
    const double to_zero = log(2) * (double)axis->params.length_long / axis->theta_per_count;
    return to_zero + (stroke->hidden_runs + 1) * ((double)axis->params.play + 2 * axis->noise + 1);
}

/* A wrong reading hides the motion of its tick and of the next one; an unreported one, or a long silence, that of a third. */
static void check_led_tick(axis_t *axis, stroke_t *stroke, int *hidden)
{
    const double before = axis->commands[0], step = 50 * axis->period;
    lead(axis, stroke);
    (void)drive(axis);
    *hidden = axis->is_wrong ? (axis->fault <= NOT_STORED ? 2 : 3) : *hidden;
    stroke->hidden_runs += axis->is_wrong;
    stroke->known += *hidden > 0 ? 0 : stroke->speed;
    *hidden -= *hidden > 0;
    at_most(0.3 + 1e-6, fabs(axis->commands[0]));
    at_most(step + 1e-6, fabs(axis->commands[0] - before));
    if (axis->compensator.wanted_q30 * (double)stroke->direction < 0) {
        at_most(counts_to_turn(axis, stroke), stroke->known);
    }
}

static axis_t faulty_axis(fault_t fault, double share)
{
    axis_t axis = noisy_axis(14, 1000, 1, 2);
    axis.fault = fault;
    axis.fault_share = share;
    axis.params.jump = 200;
    axis.params.limit = 0.3f;
    axis.params.rise = 0.1f;
    return axis;
}

static void test_wrong_readings_do_not_turn_the_torque_of_a_led_shaft(void)
{
    static const double shares[] = {0.003, 0.03, 0.2, 0.5, 0.9};
    for (int kind = 0; kind < FAULTS * 5; kind++) {
        axis_t axis = faulty_axis((fault_t)(kind / 5), shares[kind % 5]);
        stroke_t stroke = {.direction = 1};
        int hidden = 0;
        start(&axis);
        for (int t = 0; t < 50000; t++) {
            check_led_tick(&axis, &stroke, &hidden);
        }
        at_least(50000 * shares[kind % 5] * (axis.fault == JUMP ? 0.4 : 0.8), axis.compensator.rejected);
        axis.fault_share = axis.is_bad = 0;
        for (int t = 0; t < 200; t++) { /* it recovers within the rise */
            axis.theta += 2 * axis.theta_per_count;
            (void)drive(&axis);
        }
        TEST_ASSERT_DOUBLE_WITHIN(1e-4, 0.9 * TRUE_FC, axis.compensator.wanted_q30 * (double)DAHL_Q30 * TRUE_FC);
    }
}

/* If they are passed, the place of the noise within the play is lost. */
static void test_a_free_axis_comes_to_rest_if_wrong_readings_are_not_passed(void)
{
    static const double limits[] = {1.4, 0.3, 0.04};
    double largest = 0;
    for (int kind = 0; kind < FAULTS * 6; kind++) {
        const int bits = 12 + kind / 2 % 3 * 4;
        axis_t axis = noisy_axis(bits, rates_hz[kind % 2], 1, 2);
        axis.fault = (fault_t)(kind / 6);
        axis.fault_share = 0.02;
        axis.params.jump = bits < 20 ? 200 : 8000;
        const double speed = largest_speed_after_kick(axis);
        at_most(axis.fault == NOT_STORED || axis.fault == SKIPPED ? 0.02 : limits[bits / 4 - 3], speed);
        largest = fmax(largest, speed);
    }
    at_least(0.5, largest);
}

/* --- energy ----------------------------------------------------------------------------------------------------------- */

/* An adversary leads the axis and looks for paths on which compensator and friction together feed energy into the shaft. */
enum { TURNS = 40, LONGEST_STROKE = 200 };

/* Energy over Fc^2/sigma0 of a path of strokes from rest at its best end: one count per tick, under a constant torque. */
static double injected_energy(axis_t axis, const int *stroke)
{
    double energy = 0, best = 0;
    start(&axis);
    for (int turn = 0; turn < TURNS; turn++) {
        const int direction = turn % 2 == 0 ? 1 : -1;
        for (int k = 0; k < stroke[turn]; k++) {
            const double dtheta = direction * axis.theta_per_count;
            energy += axis.torque * dtheta - friction_move(&axis.friction, dtheta, 0);
            axis.torque = compensate(&axis, direction);
            best = fmax(best, energy);
        }
    }
    return best * axis.friction.sigma0 / (axis.friction.Fc * axis.friction.Fc);
}

/* Strokes of the search: both directions from `least` on, the backward ones up to `most_back`. */
typedef struct {
    int least, most_back;
} strokes_t;

static int random_stroke(strokes_t strokes, int turn, uint64_t *random)
{
    const int most = turn % 2 == 0 ? LONGEST_STROKE : strokes.most_back;
    return strokes.least + (int)(random_u32(random) % (unsigned)(most - strokes.least + 1));
}

/* Climb from two random paths: change one stroke, and keep what injects more. */
static double most_injected_energy(const axis_t *axis, strokes_t strokes)
{
    uint64_t random = 7;
    double most = 0;
    for (int path = 0; path < 2; path++) {
        int stroke[TURNS];
        for (int turn = 0; turn < TURNS; turn++) {
            stroke[turn] = random_stroke(strokes, turn, &random);
        }
        double best = injected_energy(*axis, stroke);
        for (int change = 0; change < 100; change++) {
            const int turn = (int)(random_u32(&random) % TURNS), before = stroke[turn];
            stroke[turn] = random_stroke(strokes, turn, &random);
            const double energy = injected_energy(*axis, stroke);
            stroke[turn] = energy >= best ? stroke[turn] : before;
            best = fmax(best, energy);
        }
        most = fmax(most, best);
    }
    return most;
}

/* A count is 1/26 of the presliding length. */
static const strokes_t long_strokes = {27, LONGEST_STROKE};

/* An axis whose compensator claims these multiples of the true friction. */
static axis_t claiming_axis(double gain, double Fc, double sigma0)
{
    axis_t axis = axis_of(15, 1000);
    claim(&axis, Fc * TRUE_FC, sigma0 * TRUE_SIGMA0);
    axis.params.gain = (float)gain;
    axis.params.slew = 1e6f;
    return axis;
}

/* A stroke within the play keeps the torque while the friction relaxes: a pair gains at most 2 gain Fc play. */
static double energy_of_the_play(const axis_t *axis)
{
    return 2 * (double)axis->params.gain * axis->params.play * axis->theta_per_count * axis->params.friction.Fc
         * axis->friction.sigma0 / (axis->friction.Fc * axis->friction.Fc);
}

static void test_paths_within_the_bounds_inject_no_energy_but_that_of_the_play(void)
{
    static const double inside[][3] = {{1, 1, 1}, {0.9, 1, 1}, {1, 0.7, 0.7}, {1, 0.7, 0.2}, {1, 1, 0.5}, {0.5, 1, 1}};
    double largest_part = 0;
    for (size_t k = 0; k < 2 * sizeof inside / sizeof inside[0]; k++) {
        axis_t axis = claiming_axis(inside[k / 2][0], inside[k / 2][1], inside[k / 2][2]);
        axis.params.play = k % 2 == 0 ? 1 : 6;
        const strokes_t short_strokes = {1, 2 * (int)axis.params.play};
        const double limit = TURNS / 2 * energy_of_the_play(&axis), energy = most_injected_energy(&axis, short_strokes);
        at_most(1e-3, most_injected_energy(&axis, long_strokes));
        at_most(limit, energy);
        largest_part = fmax(largest_part, energy / limit);
        axis.params.slew = 20;
        at_most(1e-3, most_injected_energy(&axis, long_strokes));
    }
    at_least(0.3, largest_part); /* the adversary is strong */
}

static void test_long_strokes_outside_the_bounds_inject_energy(void)
{
    const axis_t too_stiff = claiming_axis(1, 1, 1.1), too_strong = claiming_axis(1, 1.05, 1.05);
    at_least(1, most_injected_energy(&too_stiff, long_strokes));
    at_least(1, most_injected_energy(&too_strong, long_strokes));
}

/* SPDX-License-Identifier: MIT */
/* The measured law on a simulated axis: it comes to rest after a kick, no path of the shaft gains energy, and bad readings do not
 * turn its torque. Each limit has a case outside the promise that must miss it. The numbers are those of docs/compensation.md;
 * test_compensation_scene.py has position loops.
 */
#include <stdio.h>

#include "axis.h"
#include "dahl_encoder.h"

#define TRUE_FC 0.5       /* N m */
#define TRUE_SIGMA0 100.0 /* N m/rad: a presliding length of 5 mrad */

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

/* Wrong readings: reported and passed to dahl_encoder_move(), reported and not stored, reported with a move of 0, or not reported
 * and longer than the jump. */
typedef enum { REPORTED, NOT_STORED, SKIPPED, JUMP, FAULTS } fault_t;

typedef struct {
    axis_t axis;
    motion_t motion;
    dahl_compensator_params_t params;
    firmware_t firmware;
    dahl_encoder_t encoder;
    fault_t fault;
    double fault_share; /* of the ticks */
    int is_wrong;       /* the last reading */
    int is_bad;         /* the firmware reports a bad reading */
} rig_t;

/* An axis whose compensator knows the true friction. */
static rig_t axis_of(int bits, double rate_hz)
{
    rig_t rig;
    memset(&rig, 0, sizeof rig);
    rig.axis.friction[MOTOR] = (friction_t){.Fc = TRUE_FC, .sigma0 = TRUE_SIGMA0};
    rig.axis.inertia[MOTOR] = 0.002;
    rig.axis.period = 1 / rate_hz;
    rig.axis.count = TWO_PI / (1 << bits);
    rig.axis.delay = 1;
    rig.motion.random = 1;
    rig.params = (dahl_compensator_params_t){
        .friction = {(float)TRUE_SIGMA0, (float)TRUE_FC, (float)rig.axis.count},
        .law = DAHL_COMPENSATOR_MEASURED,
        .Fc_low = (float)TRUE_FC,
        .length_long = (float)(TRUE_FC / TRUE_SIGMA0),
        .sigma0_high = (float)TRUE_SIGMA0,
        .gain = 0.9f,
        .limit = 1.0f,
        .slew = 50.0f,
        .period = (float)rig.axis.period,
        .fall = 0.02f,
        .play = 1,
        .jump = 1u << 30,
    };
    return rig;
}

/* With noise of `noise` counts, and a play of 2 noise + more_play. */
static rig_t noisy_axis(int bits, double rate_hz, int noise, int more_play)
{
    rig_t rig = axis_of(bits, rate_hz);
    rig.axis.noise = noise;
    rig.params.noise = (uint32_t)noise;
    rig.params.play = (uint32_t)(2 * noise + more_play);
    return rig;
}

/* Bounds that follow the parameters of the element, so that prepare accepts any of them. */
static void claim(rig_t *rig, double Fc, double sigma0)
{
    rig->params.friction.Fc = (float)Fc;
    rig->params.friction.sigma0 = (float)sigma0;
    rig->params.Fc_low = rig->params.friction.Fc / 0.949f; /* for gain 1 */
    rig->params.length_long = 0.999f * rig->params.friction.Fc / rig->params.friction.sigma0;
}

static void start(rig_t *rig)
{
    rig->params.inertia = (float)rig->axis.inertia[MOTOR];
    rig->params.delay = (float)(rig->axis.delay * rig->axis.period);
    const uint32_t turn = (uint32_t)lround(TWO_PI / rig->axis.count);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_encoder_init(&rig->encoder, turn, +1, 0));
    dahl_encoder_home(&rig->encoder, 0);
    prepare_firmware(&rig->firmware, &rig->params);
}

/* Return the error of a wrong reading in counts. Jumps change their sign, so that two in a row do not cancel. */
static int32_t wrong_counts(rig_t *rig)
{
    const int32_t random = (int32_t)(random_u32(&rig->motion.random) & 0xffffu);
    return rig->fault == JUMP ? (random & 1 ? 1 : -1) * (int32_t)(2 * rig->params.jump) : random % 301 - 150;
}

/* Return the move of a tick. */
static int32_t read_encoder(rig_t *rig)
{
    int32_t counts = read_counts(&rig->axis, &rig->motion);
    rig->is_wrong = rig->fault_share > 0 && random_u32(&rig->motion.random) * 0x1p-32 < rig->fault_share;
    if (rig->fault_share > 0) {
        rig->is_bad = rig->is_wrong && rig->fault != JUMP;
        counts += rig->is_wrong ? wrong_counts(rig) : 0;
    }
    const uint32_t modulus = rig->encoder.modulus, reading = (uint32_t)counts % modulus;
    if (rig->is_bad && rig->fault != REPORTED) {
        return rig->fault == SKIPPED ? 0 : dahl_counts_between(rig->encoder.last, reading, modulus);
    }
    return dahl_encoder_move(&rig->encoder, reading);
}

/* Read the encoder and send a torque. Return the one of `delay` ticks ago, which acts now. */
static double drive(rig_t *rig)
{
    const int32_t dcounts = read_encoder(rig);
    send_command(&rig->motion, compensate(&rig->firmware, dcounts, !rig->is_bad, 0));
    return rig->motion.commands[rig->axis.delay];
}

static void tick(rig_t *rig, double external_torque)
{
    (void)drive(rig);
    advance(&rig->axis, &rig->motion, external_torque);
}

/* --- rest after a kick ------------------------------------------------------------------------------------------------ */

/* Largest speed in the last of `seconds` after a kick. */
static double speed_after_kick(rig_t rig, double seconds)
{
    double largest = 0;
    start(&rig);
    rig.motion.speed[MOTOR] = 3;
    const int ticks = (int)lround(seconds / rig.axis.period), last = (int)lround(1 / rig.axis.period);
    for (int t = 0; t < ticks; t++) {
        tick(&rig, 0);
        largest = t >= ticks - last ? fmax(largest, fabs(rig.motion.speed[MOTOR])) : 0;
    }
    return largest;
}

/* Of light and heavy axes with 1 to 3 ticks of delay. */
static double largest_speed_after_kick(rig_t rig)
{
    double largest = 0;
    for (rig.axis.delay = 1; rig.axis.delay <= 3; rig.axis.delay++) {
        for (int kind = 0; kind < 2; kind++) {
            rig.axis.inertia[MOTOR] = kind == 0 ? 0.002 : 0.02;
            largest = fmax(largest, speed_after_kick(rig, 4));
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
            rig_t rig = noisy_axis(bits, rates_hz[kind % 2], 1 + kind / 2 % 2, 2);
            rig.axis.is_noise_after_rounding = is_after;
            at_most(0.02, largest_speed_after_kick(rig));
            rig.params.play -= 2;
            const double speed = largest_speed_after_kick(rig);
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
        rig_t rig = noisy_axis(20, 8000, 1, 2);
        rig.axis.friction[MOTOR].breakaway = breakaway[kind] * TRUE_FC;
        rig.axis.friction[MOTOR].stribeck_speed = stribeck_speed[kind];
        at_least(kind == 1 ? 0.1 : 0, largest_speed_after_kick(rig)); /* claims Fc/sigma0 */
        claim(&rig, TRUE_FC, TRUE_SIGMA0 / breakaway[kind]);
        at_most(0.02, largest_speed_after_kick(rig));
    }
}

/* Such an axis swings by itself. */
static void test_three_times_the_length_damps_slip_friction(void)
{
    static const double limits[] = {0.45, 0.23, 0.12, 0.06};
    for (int bits = 12; bits < 16; bits++) {
        rig_t rig = noisy_axis(bits, 1000, 1, 2);
        rig.axis.friction[MOTOR].springs = 1;
        rig_t uncompensated = rig;
        uncompensated.params.gain = 0;
        claim(&rig, TRUE_FC, TRUE_SIGMA0 / 3);
        at_least(1, largest_speed_after_kick(uncompensated));
        at_most(limits[bits - 12], largest_speed_after_kick(rig));
    }
}

static void test_the_fade_over_speed_stops_a_runaway(void)
{
    rig_t rig = axis_of(14, 1000);
    claim(&rig, 1.3 * TRUE_FC, 1.3 * TRUE_SIGMA0);
    rig.params.gain = 1;
    rig.params.jump = 2000;
    at_least(100, speed_after_kick(rig, 10));
    rig.params.fade_speed = 1;
    at_most(2, speed_after_kick(rig, 10));
}

/* --- a shaken axis, and a hand ---------------------------------------------------------------------------------------- */

/* Largest mean speed of an axis that a torque of 10 to 160 Hz shakes after a kick, when the start of the shakes has faded. */
static double shaken_speed(double gain, int more_play, int is_reported_at_rest)
{
    double largest = 0;
    for (double hertz = 10; hertz <= 160; hertz *= 2) {
        for (double amplitude = 0.2 * TRUE_FC; amplitude < TRUE_FC; amplitude *= 2) {
            rig_t rig = noisy_axis(14, 8000, 1, more_play);
            double begin = 0;
            rig.params.gain = (float)gain;
            start(&rig);
            rig.motion.speed[MOTOR] = 3;
            for (int t = 0; t < 4 * 8000; t++) {
                begin = t == 2 * 8000 ? rig.motion.theta[MOTOR] : begin;
                rig.is_bad = t >= 4000 && is_reported_at_rest;
                tick(&rig, t < 4000 ? 0 : amplitude * sin(TWO_PI * hertz * t / 8000));
            }
            largest = fmax(largest, fabs(rig.motion.theta[MOTOR] - begin) / 2);
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
static double hand_ratio(rig_t rig, double amplitude)
{
    double with = 0, without = 0;
    start(&rig);
    for (int t = 0; t * rig.axis.period < 6; t++) {
        const double s = TWO_PI * 0.5 * t * rig.axis.period, theta = amplitude * (sin(s) + 0.2 * sin(3.4 * s));
        const double motor = drive(&rig);
        (void)friction_move(&rig.axis.friction[MOTOR], &rig.motion.bristle[MOTOR], theta - rig.motion.theta[MOTOR], 0);
        rig.motion.theta[MOTOR] = theta;
        const double F = rig.motion.bristle[MOTOR].spring[0];
        with += (F - motor) * (F - motor);
        without += F * F;
    }
    return sqrt(with / without);
}

static void test_a_hand_feels_a_wider_play_in_small_motions(void)
{
    static const double large[] = {0.13, 0.155}, small[] = {0.205, 0.435};
    for (int kind = 0; kind < 8; kind++) {
        const int is_wide = kind / 4;
        const rig_t rig = noisy_axis(14, rates_hz[kind % 2], 1 + kind / 2 % 2, 2 * is_wide);
        at_most(large[is_wide], hand_ratio(rig, 0.5));
        at_most(small[is_wide], hand_ratio(rig, 0.0025));
    }
}

/* --- bad readings ----------------------------------------------------------------------------------------------------- */

/* A shaft is led in strokes of any length and speed. */
typedef struct {
    int direction, ticks;
    double speed;              /* counts per tick */
    double known, hidden_runs; /* counts between good readings in this stroke, and their interruptions */
} stroke_t;

static void lead(rig_t *rig, stroke_t *stroke)
{
    if (stroke->ticks-- == 0) {
        stroke->direction = -stroke->direction;
        stroke->speed = 30 * pow(2, -8 * (random_u32(&rig->motion.random) * 0x1p-32));
        stroke->ticks = (int)(random_u32(&rig->motion.random) % 300);
        stroke->known = stroke->hidden_runs = 0;
    }
    rig->motion.theta[MOTOR] += stroke->direction * stroke->speed * rig->axis.count;
}

/* Counts after which the torque has the sign of the motion: the travel from -Fc to 0, and the play, noise and rounding of each run
 * of good readings. */
static double counts_to_turn(const rig_t *rig, const stroke_t *stroke)
{
    const double to_zero = log(2) * (double)rig->params.length_long / rig->axis.count;
    return to_zero + (stroke->hidden_runs + 1) * ((double)rig->params.play + 2 * rig->axis.noise + 1);
}

/* A wrong reading hides the motion of its tick and of the next one; an unreported one, or a long silence, that of a third. */
static void check_led_tick(rig_t *rig, stroke_t *stroke, int *hidden)
{
    const double before = rig->motion.commands[0], step = 50 * rig->axis.period;
    lead(rig, stroke);
    (void)drive(rig);
    *hidden = rig->is_wrong ? (rig->fault <= NOT_STORED ? 2 : 3) : *hidden;
    stroke->hidden_runs += rig->is_wrong;
    stroke->known += *hidden > 0 ? 0 : stroke->speed;
    *hidden -= *hidden > 0;
    at_most(0.3 + 1e-6, fabs(rig->motion.commands[0]));
    at_most(step + 1e-6, fabs(rig->motion.commands[0] - before));
    if (rig->firmware.compensator.wanted_q30 * (double)stroke->direction < 0) {
        at_most(counts_to_turn(rig, stroke), stroke->known);
    }
}

static rig_t faulty_axis(fault_t fault, double share)
{
    rig_t rig = noisy_axis(14, 1000, 1, 2);
    rig.fault = fault;
    rig.fault_share = share;
    rig.params.jump = 200;
    rig.params.limit = 0.3f;
    rig.params.rise = 0.1f;
    return rig;
}

static void test_wrong_readings_do_not_turn_the_torque_of_a_led_shaft(void)
{
    static const double shares[] = {0.003, 0.03, 0.2, 0.5, 0.9};
    for (int kind = 0; kind < FAULTS * 5; kind++) {
        rig_t rig = faulty_axis((fault_t)(kind / 5), shares[kind % 5]);
        stroke_t stroke = {.direction = 1};
        int hidden = 0;
        start(&rig);
        for (int t = 0; t < 50000; t++) {
            check_led_tick(&rig, &stroke, &hidden);
        }
        at_least(50000 * shares[kind % 5] * (rig.fault == JUMP ? 0.4 : 0.8), rig.firmware.compensator.rejected);
        rig.fault_share = rig.is_bad = 0;
        for (int t = 0; t < 200; t++) { /* it recovers within the rise */
            rig.motion.theta[MOTOR] += 2 * rig.axis.count;
            (void)drive(&rig);
        }
        TEST_ASSERT_DOUBLE_WITHIN(1e-4, 0.9 * TRUE_FC, rig.firmware.compensator.wanted_q30 * (double)DAHL_Q30 * TRUE_FC);
    }
}

/* If they are passed, the place of the noise within the play is lost. */
static void test_a_free_axis_comes_to_rest_if_wrong_readings_are_not_passed(void)
{
    static const double limits[] = {1.4, 0.3, 0.04};
    double largest = 0;
    for (int kind = 0; kind < FAULTS * 6; kind++) {
        const int bits = 12 + kind / 2 % 3 * 4;
        rig_t rig = noisy_axis(bits, rates_hz[kind % 2], 1, 2);
        rig.fault = (fault_t)(kind / 6);
        rig.fault_share = 0.02;
        rig.params.jump = bits < 20 ? 200 : 8000;
        const double speed = largest_speed_after_kick(rig);
        at_most(rig.fault == NOT_STORED || rig.fault == SKIPPED ? 0.02 : limits[bits / 4 - 3], speed);
        largest = fmax(largest, speed);
    }
    at_least(0.5, largest);
}

/* --- energy ----------------------------------------------------------------------------------------------------------- */

/* An adversary leads the axis and looks for paths on which compensator and friction together feed energy into the shaft. */
enum { TURNS = 40, LONGEST_STROKE = 200 };

/* Energy over Fc^2/sigma0 of a path of strokes from rest at its best end: one count per tick, under a constant torque. */
static double injected_energy(rig_t rig, const int *stroke)
{
    double energy = 0, best = 0;
    start(&rig);
    for (int turn = 0; turn < TURNS; turn++) {
        const int direction = turn % 2 == 0 ? 1 : -1;
        for (int k = 0; k < stroke[turn]; k++) {
            const double dtheta = direction * rig.axis.count;
            energy += rig.firmware.torque * dtheta;
            energy -= friction_move(&rig.axis.friction[MOTOR], &rig.motion.bristle[MOTOR], dtheta, 0);
            (void)compensate(&rig.firmware, direction, 1, 0);
            best = fmax(best, energy);
        }
    }
    return best * rig.axis.friction[MOTOR].sigma0 / (rig.axis.friction[MOTOR].Fc * rig.axis.friction[MOTOR].Fc);
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
static double most_injected_energy(const rig_t *rig, strokes_t strokes)
{
    uint64_t random = 7;
    double most = 0;
    for (int path = 0; path < 2; path++) {
        int stroke[TURNS];
        for (int turn = 0; turn < TURNS; turn++) {
            stroke[turn] = random_stroke(strokes, turn, &random);
        }
        double best = injected_energy(*rig, stroke);
        for (int change = 0; change < 100; change++) {
            const int turn = (int)(random_u32(&random) % TURNS), before = stroke[turn];
            stroke[turn] = random_stroke(strokes, turn, &random);
            const double energy = injected_energy(*rig, stroke);
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
static rig_t claiming_axis(double gain, double Fc, double sigma0)
{
    rig_t rig = axis_of(15, 1000);
    claim(&rig, Fc * TRUE_FC, sigma0 * TRUE_SIGMA0);
    rig.params.gain = (float)gain;
    rig.params.slew = 1e6f;
    return rig;
}

/* A stroke within the play keeps the torque while the friction relaxes: a pair gains at most 2 gain Fc play. */
static double energy_of_the_play(const rig_t *rig)
{
    return 2 * (double)rig->params.gain * rig->params.play * rig->axis.count * rig->params.friction.Fc
         * rig->axis.friction[MOTOR].sigma0 / (rig->axis.friction[MOTOR].Fc * rig->axis.friction[MOTOR].Fc);
}

static void test_paths_within_the_bounds_inject_no_energy_but_that_of_the_play(void)
{
    static const double inside[][3] = {{1, 1, 1}, {0.9, 1, 1}, {1, 0.7, 0.7}, {1, 0.7, 0.2}, {1, 1, 0.5}, {0.5, 1, 1}};
    double largest_part = 0;
    for (size_t k = 0; k < 2 * sizeof inside / sizeof inside[0]; k++) {
        rig_t rig = claiming_axis(inside[k / 2][0], inside[k / 2][1], inside[k / 2][2]);
        rig.params.play = k % 2 == 0 ? 1 : 6;
        const strokes_t short_strokes = {1, 2 * (int)rig.params.play};
        const double limit = TURNS / 2 * energy_of_the_play(&rig), energy = most_injected_energy(&rig, short_strokes);
        at_most(1e-3, most_injected_energy(&rig, long_strokes));
        at_most(limit, energy);
        largest_part = fmax(largest_part, energy / limit);
        rig.params.slew = 20;
        at_most(1e-3, most_injected_energy(&rig, long_strokes));
    }
    at_least(0.3, largest_part); /* the adversary is strong */
}

static void test_long_strokes_outside_the_bounds_inject_energy(void)
{
    const rig_t too_stiff = claiming_axis(1, 1, 1.1), too_strong = claiming_axis(1, 1.05, 1.05);
    at_least(1, most_injected_energy(&too_stiff, long_strokes));
    at_least(1, most_injected_energy(&too_strong, long_strokes));
}

/* SPDX-License-Identifier: MIT */
/* An adversary leads a free axis with the measured law, and looks for paths on which compensator and friction together feed
 * energy into the shaft. Strokes longer than the play and the presliding length must give none. A shorter one hides in the
 * play: the torque stays while the friction relaxes. A pair of strokes then gives at most 2 gain Fc play, and the first long
 * stroke after them at most 2 Fc length_long. */
#include "axis.h"

#ifndef TEST_ENERGY_PART /* of the search: 1 for all of it */
#define TEST_ENERGY_PART 1
#endif

enum { TURNS = 40, LONGEST_STROKE = 200 };

/* Energy over Fc^2/sigma0 of a path of strokes from rest, one count per tick, at its best end. The torque is held during a tick. */
static double injected_energy(axis_t axis, const int *stroke)
{
    double energy = 0, best = 0;
    axis_start(&axis);
    for (int turn = 0; turn < TURNS; turn++) {
        const int direction = turn % 2 == 0 ? 1 : -1;
        for (int k = 0; k < stroke[turn]; k++) {
            const double dtheta = direction * axis.theta_per_count;
            energy += axis.torque * dtheta - friction_move(&axis.friction, dtheta, 0);
            axis.torque = axis_compensate(&axis, direction);
            best = fmax(best, energy);
        }
    }
    return best * axis.friction.sigma0 / (axis.friction.Fc * axis.friction.Fc);
}

/* The largest energy of two strokes that hides in the play, in the same unit. */
static double energy_of_the_play(const axis_t *axis)
{
    return 2 * (double)axis->params.gain * axis->params.play * axis->theta_per_count * axis->params.friction.Fc
         * axis->friction.sigma0 / (axis->friction.Fc * axis->friction.Fc);
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

/* Climb from several random paths: change one stroke, and keep what injects more. */
static double most_injected_energy(const axis_t *axis, strokes_t strokes, int paths, int changes)
{
    uint64_t random = 7;
    double most = 0;
    for (int path = 0; path < paths; path++) {
        int stroke[TURNS];
        for (int turn = 0; turn < TURNS; turn++) {
            stroke[turn] = random_stroke(strokes, turn, &random);
        }
        double best = injected_energy(*axis, stroke);
        for (int change = 0; change < changes / TEST_ENERGY_PART; change++) {
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

/* A count is 1/26 of the presliding length. The compensator claims the bounds Fc_hat and sigma0_hat. */
enum { LENGTH_COUNTS = 27 };

static axis_t path_of(double gain, double Fc_hat, double sigma0_hat)
{
    axis_t axis = axis_of(DAHL_COMPENSATOR_MEASURED, 15, 1000);
    axis_claim(&axis, Fc_hat * TRUE_FC, sigma0_hat * TRUE_SIGMA0);
    axis.params.gain = (float)gain;
    axis.params.slew = 1e6f;
    return axis;
}

static const double inside[][3] = {{1, 1, 1}, {0.9, 1, 1}, {1, 0.7, 0.7}, {1, 0.7, 0.2}, {1, 1, 0.5}, {0.5, 1, 1}};
enum { INSIDE = sizeof inside / sizeof inside[0] };

static void test_long_strokes_within_the_bounds_inject_no_energy(void)
{
    static const strokes_t strokes = {LENGTH_COUNTS, LONGEST_STROKE};
    for (int k = 0; k < 2 * INSIDE; k++) {
        axis_t axis = path_of(inside[k / 2][0], inside[k / 2][1], inside[k / 2][2]);
        axis.params.play = k % 2 == 0 ? 1 : 6;
        at_most(1e-3, most_injected_energy(&axis, strokes, 2, 100));
        axis.params.slew = 20;
        at_most(1e-3, most_injected_energy(&axis, strokes, 1, 50));
    }
}

static void test_short_strokes_inject_at_most_the_energy_of_the_play(void)
{
    double largest_part = 0;
    for (int k = 0; k < 2 * INSIDE; k++) {
        axis_t axis = path_of(inside[k / 2][0], inside[k / 2][1], inside[k / 2][2]);
        axis.params.play = k % 2 == 0 ? 1 : 6;
        const strokes_t strokes = {1, 2 * (int)axis.params.play};
        const double limit = TURNS / 2 * energy_of_the_play(&axis), energy = most_injected_energy(&axis, strokes, 2, 100);
        at_most(limit, energy);
        largest_part = fmax(largest_part, energy / limit);
    }
    at_least(0.3, largest_part); /* the adversary is strong */
}

static void test_long_strokes_outside_the_bounds_inject_energy(void)
{
    static const double outside[][3] = {{1, 1, 1.1}, {1, 1.05, 1.05}};
    static const strokes_t strokes = {LENGTH_COUNTS, LONGEST_STROKE};
    for (size_t k = 0; k < sizeof outside / sizeof outside[0]; k++) {
        axis_t axis = path_of(outside[k][0], outside[k][1], outside[k][2]);
        at_least(1, most_injected_energy(&axis, strokes, 2, 100));
    }
}

/* Move the shaft to a place in counts, and read the encoder. Returns the energy that the shaft gets. */
static double visit(axis_t *axis, double place)
{
    const double dtheta = place * axis->theta_per_count - axis->theta;
    const double energy = axis->torque * dtheta - friction_move(&axis->friction, dtheta, 0);
    axis->theta += dtheta;
    const int32_t counts = axis_read(axis);
    axis->torque = axis_compensate(axis, counts - axis->last_counts);
    axis->last_counts = counts;
    return energy;
}

#define START 270 /* counts, ten presliding lengths */
#define DRIFT_COUNTS 60
#define SHAKES_PER_COUNT 48

/* No law of the encoder alone can distinguish a slow drift from the same drift with a shake within each count. The drift needs
 * the torque. With the shake, the friction is relaxed, and the shaft gets gain Fc per drift, less Fc (1/(2 N) + N (a h)^2/6) for
 * N shakes in a count of h rad, a = sigma0/Fc. */
static void test_a_shake_within_a_count_hides_from_any_law(void)
{
    for (int kind = 0; kind < 2; kind++) {
        axis_t drift = path_of(kind == 0 ? 0.9 : 1, 1, 1);
        double drift_energy = 0, shaken_energy = 0;
        axis_start(&drift);
        for (int count = 0; count < START; count++) {
            (void)visit(&drift, count);
        }
        axis_t shaken = drift;
        for (int shake = 0; shake < DRIFT_COUNTS * SHAKES_PER_COUNT; shake++) {
            const int count = START + shake / SHAKES_PER_COUNT;
            const double place = START + (shake + 0.5) / SHAKES_PER_COUNT, places[] = {count + 0.99, count + 0.01, place};
            for (int k = 0; k < 3; k++) {
                drift_energy += visit(&drift, place);
                shaken_energy += visit(&shaken, places[k]);
                TEST_ASSERT_EQUAL_INT32(drift.last_counts, shaken.last_counts);
                TEST_ASSERT_EQUAL_INT32(drift.compensator.torque_q30, shaken.compensator.torque_q30);
            }
        }
        const double most = (double)drift.params.gain * TRUE_FC * DRIFT_COUNTS * drift.theta_per_count;
        at_most(1e-3 * TRUE_FC * TRUE_FC / TRUE_SIGMA0, drift_energy);
        at_most(most, shaken_energy);
        at_least(0.94 * most, shaken_energy);
    }
}

/* The friction is relaxed, while the torque stays at Fc. Both approach Fc on the stroke. */
static void test_a_long_stroke_after_shakes_gets_at_most_twice_the_energy_of_presliding(void)
{
    for (uint32_t play = 1; play <= 9; play += 4) {
        axis_t axis = path_of(1, 1, 1);
        axis.params.play = play;
        int stroke[TURNS];
        for (int turn = 0; turn < TURNS; turn++) {
            stroke[turn] = turn == 0 ? 6 * LENGTH_COUNTS : (int)play;
        }
        stroke[TURNS - 1] = stroke[TURNS - 2] = 0;
        const double before = injected_energy(axis, stroke);
        stroke[TURNS - 2] = 6 * LENGTH_COUNTS;
        const double energy = injected_energy(axis, stroke) - before; /* 1: Fc length_long */
        at_least(0.3, energy);
        at_most(2, energy);
    }
}

/* SPDX-License-Identifier: MIT */
/* The rules of the measured law on random axes: rigid, loaded, elastic. Inside each rule no axis swings. Outside it prepare
 * refuses, and with false bounds, which prepare cannot see, some axes swing. docs/compensation.md has the promise.
 *
 * The axis is in double precision: one mass, or two with a shaft between them, and Dahl's friction on both. Encoder and motor
 * are on the first. The torque is held for a tick, acts some ticks late, and has the lag of a current loop. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "../random.h"
#include "dahl_compensator.h"

#ifndef TEST_AXES
#define TEST_AXES 40
#endif
#define TWO_PI 6.283185307179586
#define KICK_S 0.01
#define LEAST_RINGS 3.0 /* e-foldings of the shaft's own damping */

enum { MOTOR, LOAD, MASSES, LATEST = 8 };

static uint64_t seed = 1;

static double uniform(double least, double most)
{
    return least + (most - least) * (random_u32(&seed) * 0x1p-32);
}

static double log_uniform(double least, double most)
{
    return least * pow(most / least, uniform(0, 1));
}

static int choose(int choices)
{
    return (int)(random_u32(&seed) % (unsigned)choices);
}

/* --- the axis --------------------------------------------------------------------------------------------------------- */

typedef struct {
    double inertia[MASSES], Fc[MASSES], sigma0[MASSES]; /* kg m2; 0: a rigid axis */
    double shaft, damping;                              /* N m/rad, N m s/rad between the masses */
    double load;                                        /* N m, constant */
    double lag, count;                                  /* s, rad */
    int delay, bits;                                    /* ticks */
    dahl_compensator_params_t params;
} axis_t;

typedef struct {
    double kick, motor_kick, tap; /* rad/s of the axis, of the motor alone; N m for KICK_S after a third of the time */
} push_t;

typedef struct {
    double theta[MASSES], speed[MASSES], F[MASSES];
    double torque, commands[LATEST]; /* N m of the motor now; of the last ticks */
    uint64_t random;
    int32_t counts;
    dahl_plan_t element;
    dahl_state_t bristle;
    dahl_compensator_plan_t plan;
    dahl_compensator_t compensator;
} motion_t;

static int is_elastic(const axis_t *axis)
{
    return axis->inertia[LOAD] > 0;
}

static double period_of(const axis_t *axis)
{
    return (double)axis->params.period;
}

/* rad/s of the motor on the bristles. */
static double bristle_frequency(const axis_t *axis)
{
    return sqrt((axis->sigma0[MOTOR] + axis->sigma0[LOAD]) / axis->inertia[MOTOR]);
}

/* N m/s */
static double least_slew(const axis_t *axis)
{
    return (axis->Fc[MOTOR] + axis->Fc[LOAD]) * fmax(20, bristle_frequency(axis) / 25);
}

/* Torque of the compensator after a reading. */
static double compensate(const axis_t *axis, motion_t *m)
{
    const double noise = axis->params.noise * (random_u32(&m->random) * 0x1p-31 - 1);
    const int32_t counts = (int32_t)floor(m->theta[MOTOR] / axis->count + noise), before = m->counts;
    m->counts = counts;
    const int32_t move = dahl_compensator_move(&m->plan, &m->compensator, counts - before, 1);
    const int32_t ratio = dahl_step_counts_q30(&m->element, &m->bristle, move);
    return dahl_compensator_torque(&m->plan, &m->compensator, ratio) * (double)DAHL_Q30 * (double)axis->params.friction.Fc;
}

/* Semi-implicit: first the speeds, then angles and friction. The friction is exact over a move. */
static void substep(const axis_t *axis, motion_t *m, double external, double h)
{
    const int masses = is_elastic(axis) ? 2 : 1;
    const double twist = m->theta[MOTOR] - m->theta[LOAD], rate = m->speed[MOTOR] - m->speed[LOAD];
    const double shaft = masses == 2 ? axis->shaft * twist + axis->damping * rate : 0;
    const double torques[MASSES] = {m->torque - shaft + (masses == 1 ? external : 0), shaft + external};
    for (int k = 0; k < masses; k++) {
        m->speed[k] += (torques[k] - m->F[k]) / axis->inertia[k] * h;
        const double move = m->speed[k] * h, goal = move < 0 ? -axis->Fc[k] : axis->Fc[k];
        m->theta[k] += move;
        m->F[k] = axis->Fc[k] > 0 ? goal + (m->F[k] - goal) * exp(-axis->sigma0[k] / axis->Fc[k] * fabs(move)) : 0;
    }
}

static double fastest(const axis_t *axis, const motion_t *m)
{
    return fmax(fabs(m->speed[MOTOR]), is_elastic(axis) ? fabs(m->speed[LOAD]) : 0);
}

static int substeps_of(const axis_t *axis)
{
    double square = bristle_frequency(axis) * bristle_frequency(axis);
    if (is_elastic(axis)) {
        square += axis->shaft * (1 / axis->inertia[MOTOR] + 1 / axis->inertia[LOAD]) + axis->sigma0[LOAD] / axis->inertia[LOAD];
    }
    return (int)fmax(12, ceil(period_of(axis) * sqrt(square) / 0.06));
}

/* Largest speed in the last fifth of `seconds` after a push. */
static double end_speed(const axis_t *axis, push_t push, double seconds, int is_compensated)
{
    const int substeps = substeps_of(axis), ticks = (int)(seconds / period_of(axis));
    const double h = period_of(axis) / substeps, closed = axis->lag > 0 ? 1 - exp(-h / axis->lag) : 1;
    const int pushed = ticks / 3, released = pushed + (int)(KICK_S / period_of(axis)) + 1;
    motion_t m;
    double largest = 0;
    memset(&m, 0, sizeof m);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_prepare(&m.element, &axis->params.friction));
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_compensator_prepare(&m.plan, &axis->params));
    m.speed[MOTOR] = push.kick + push.motor_kick;
    m.speed[LOAD] = push.kick;
    for (int t = 0; t < ticks; t++) {
        memmove(&m.commands[1], &m.commands[0], (LATEST - 1) * sizeof m.commands[0]);
        m.commands[0] = is_compensated ? compensate(axis, &m) : 0;
        const double external = axis->load + (pushed <= t && t < released ? push.tap : 0);
        for (int k = 0; k < substeps; k++) {
            m.torque += (m.commands[axis->delay] - m.torque) * closed;
            substep(axis, &m, external, h);
        }
        largest = t >= ticks - ticks / 5 ? fmax(largest, fastest(axis, &m)) : 0;
        if (m.speed[MOTOR] > 1e6) {
            return m.speed[MOTOR]; /* runs away */
        }
    }
    return largest;
}

/* --- the promise ------------------------------------------------------------------------------------------------------ */

static double promised_excess(const axis_t *axis)
{
    return fmax(0.02, 2 * axis->count * bristle_frequency(axis));
}

/* Time to rest after a momentum under the least net friction, and some swings. */
static double seconds_of(const axis_t *axis, push_t push)
{
    const double inertia = axis->inertia[MOTOR] + axis->inertia[LOAD], Fc = axis->Fc[MOTOR] + axis->Fc[LOAD];
    const double momentum = fabs(push.kick) * inertia + fabs(push.motor_kick) * axis->inertia[MOTOR] + fabs(push.tap) * KICK_S;
    const double net = fmax(0.02 * Fc, Fc - fabs(axis->load) - (double)axis->params.gain * (double)axis->params.friction.Fc);
    const double shaft = axis->damping * (1 / axis->inertia[MOTOR] + (is_elastic(axis) ? 1 / axis->inertia[LOAD] : 0)) / 2;
    const double ringing = is_elastic(axis) ? fmin(10, 3 * LEAST_RINGS / shaft) : 0;
    return fmax(0.5, 300 / bristle_frequency(axis)) + 1.4 * momentum / net + ringing;
}

/* A slow decay is no swing: longer runs must show it too. */
static int swings(const axis_t *axis, push_t push)
{
    double seconds = seconds_of(axis, push), excess = 0;
    for (int run = 0; run < 3; run++, seconds *= 4) {
        excess = end_speed(axis, push, seconds, 1);
        if (excess <= promised_excess(axis) || excess - end_speed(axis, push, seconds, 0) <= promised_excess(axis)) {
            return 0;
        }
    }
    return 1;
}

static int swings_after_any(const axis_t *axis, const push_t *pushes, int count)
{
    for (int k = 0; k < count; k++) {
        if (swings(axis, pushes[k])) {
            return 1;
        }
    }
    return 0;
}

/* --- random axes ------------------------------------------------------------------------------------------------------ */

/* u is the largest of sqrt(sigma0_high/(3 inertia)) (delay + period/2): rule 1 is u <= 1. */
static axis_t random_axis(double length, double Fc, double u)
{
    static const float periods[] = {1e-4f, 2.5e-4f, 5e-4f, 1e-3f}, gains[] = {0.2f, 0.5f, 0.7f, 0.9f, 0.95f};
    static const double slews[] = {1, 5, 50, 5000}, lags[] = {0, 0, 0.3, 1};
    axis_t axis;
    memset(&axis, 0, sizeof axis);
    const double period = (double)periods[choose(4)], sigma0 = Fc / length;
    axis.delay = choose(LATEST);
    axis.lag = lags[choose(4)] * period;
    axis.bits = 14 + choose(7);
    const double delay = axis.delay * period + axis.lag + 1e-9, late = delay + period / 2;
    axis.Fc[MOTOR] = Fc;
    axis.sigma0[MOTOR] = sigma0;
    axis.inertia[MOTOR] = fmax(sigma0 * late * late / 3 / u / u, sigma0 * period * period / 9);
    axis.params = (dahl_compensator_params_t){.law = DAHL_COMPENSATOR_MEASURED, .sigma0_high = (float)(sigma0 * 1.000001),
                                              .inertia = (float)(axis.inertia[MOTOR] * 0.999999), .delay = (float)delay,
                                              .gain = gains[choose(5)], .slew = (float)(slews[choose(4)] * least_slew(&axis)),
                                              .limit = (float)(1.2 * Fc), .period = (float)period, .jump = 1u << 30};
    axis.params.noise = (uint32_t)choose(3);
    return axis;
}

/* Build the element from the bounds, as the page says. */
static void set_bounds(axis_t *axis, double Fc_low, double length_long, int lengths)
{
    dahl_compensator_params_t *p = &axis->params;
    axis->count = TWO_PI / (1 << axis->bits);
    p->play = p->noise > 0 ? 2 * p->noise + 2 : 1;
    p->Fc_low = (float)Fc_low;
    p->length_long = (float)length_long;
    p->elastic = lengths > 1;
    p->friction.Fc = p->Fc_low;
    p->friction.sigma0 = p->Fc_low / ((float)lengths * p->length_long);
    p->friction.theta_per_count = (float)axis->count;
}

static int is_play_short(const axis_t *axis)
{
    return axis->params.play * axis->count < (double)axis->params.length_long;
}

static axis_t random_rigid_axis(double least_u, double most_u, int is_known)
{
    axis_t axis;
    do {
        const double length = log_uniform(0.5e-3, 20e-3), Fc = log_uniform(0.02, 5);
        axis = random_axis(length, Fc, uniform(least_u, most_u));
        set_bounds(&axis, Fc * (is_known ? 1 : uniform(0.7, 1)), length * (is_known ? 1.000001 : uniform(1.000001, 1.5)), 1);
    } while (!is_play_short(&axis));
    return axis;
}

static int rigid_axis_swings(const axis_t *axis)
{
    const double V = axis->Fc[MOTOR] / axis->sigma0[MOTOR] * bristle_frequency(axis);
    const push_t pushes[] = {{0.5 * V, 0, 0}, {3 * V, 0, 0}, {20 * V, 0, 0}};
    return swings_after_any(axis, pushes, 3);
}

static dahl_compensator_err_t code_of(const axis_t *axis)
{
    dahl_compensator_plan_t plan;
    return dahl_compensator_prepare(&plan, &axis->params);
}

static void test_a_rigid_axis_rests_inside_the_rule_of_the_inertia(void)
{
    for (int k = 0; k < TEST_AXES; k++) {
        const axis_t axis = random_rigid_axis(0.05, 0.9999, k % 3 == 0);
        TEST_ASSERT_FALSE(rigid_axis_swings(&axis));
    }
}

/* A light rotor with each bound at its edge. It swings by some counts if the slew is 20 Fc in a second. */
static void test_a_light_rotor_needs_a_fast_slew(void)
{
    int swinging = 0;
    for (int k = 0; k < TEST_AXES / 2; k++) {
        axis_t axis = random_rigid_axis(0.9999, 0.9999, 1);
        while (axis.delay < 3 || axis.bits < 17 || bristle_frequency(&axis) < 2000) {
            axis = random_rigid_axis(0.9999, 0.9999, 1);
        }
        axis.params.gain = 0.9f;
        axis.params.slew = (float)least_slew(&axis);
        TEST_ASSERT_FALSE(rigid_axis_swings(&axis));
        axis.params.slew = 20 * axis.params.friction.Fc;
        swinging += rigid_axis_swings(&axis);
    }
    TEST_ASSERT_GREATER_THAN_INT(0, swinging);
}

static void test_a_lighter_rotor_is_refused_and_can_swing(void)
{
    int swinging = 0;
    for (int k = 0; k < TEST_AXES / 2; k++) {
        axis_t axis = random_rigid_axis(1.6, 2.2, 1);
        while (axis.delay == 0) {
            axis = random_rigid_axis(1.6, 2.2, 1);
        }
        axis.params.gain = 0.9f;
        TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_INERTIA, code_of(&axis));
        axis.params.inertia *= 5; /* a false bound */
        swinging += rigid_axis_swings(&axis);
    }
    TEST_ASSERT_GREATER_THAN_INT(TEST_AXES / 8, swinging);
}

/* Set a load, and a gain of `part` times what rule 2 permits without its 0.95. */
static void set_load(axis_t *axis, double share, double part)
{
    const double Fc_low = (double)axis->params.Fc_low, load = share * Fc_low;
    axis->load = choose(2) == 0 ? load : -load;
    axis->params.load = (float)load;
    axis->params.gain = (float)(part * (Fc_low - load) / Fc_low);
}

static int loaded_axis_swings(const axis_t *axis)
{
    const double Fc = axis->Fc[MOTOR], V = Fc / axis->sigma0[MOTOR] * bristle_frequency(axis);
    const double tap = axis->load < 0 ? -2 * Fc : 2 * Fc;
    const push_t pushes[] = {{V, 0, 0}, {-6 * V, 0, 0}, {20 * V, 0, 0}, {0, 0, tap}, {0, 0, -tap}};
    return swings_after_any(axis, pushes, 5);
}

static void test_a_loaded_axis_rests_inside_the_rule_of_the_gain(void)
{
    for (int k = 0; k < TEST_AXES; k++) {
        axis_t axis = random_rigid_axis(0.05, 0.9999, 0);
        set_load(&axis, uniform(0.05, 0.85), uniform(0.7, 0.9499));
        TEST_ASSERT_FALSE(loaded_axis_swings(&axis));
    }
}

static void test_a_load_that_the_gain_does_not_leave_is_refused_and_can_drive_the_axis(void)
{
    int driven = 0;
    for (int k = 0; k < TEST_AXES / 2; k++) {
        axis_t axis = random_rigid_axis(0.05, 0.9999, 1);
        set_load(&axis, uniform(0.3, 0.85), uniform(1.05, 1.3));
        TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_GAIN, code_of(&axis));
        axis.params.load = 0; /* a false bound */
        driven += loaded_axis_swings(&axis);
    }
    TEST_ASSERT_GREATER_THAN_INT(TEST_AXES / 8, driven);
}

/* Two masses, resonance 20 to 300 Hz, friction on one or both. */
static axis_t random_elastic_axis(int lengths, int is_known)
{
    static const double shares[] = {0, 0, 0.3, 0.6, 1};
    for (;;) {
        const double length = log_uniform(1e-3, 20e-3), Fc = 0.5, sigma0 = Fc / length;
        axis_t axis = random_axis(length, Fc, is_known ? 0.999 : log_uniform(0.03, 0.999));
        const double late = (double)axis.params.delay + period_of(&axis) / 2, rotor = uniform(0.1, 0.9);
        const double hertz = is_known ? uniform(0.3, 1) / TWO_PI / late : log_uniform(20, 300);
        const double reduced = axis.inertia[MOTOR] * (1 - rotor), share = is_known ? 0 : shares[choose(5)];
        axis.inertia[LOAD] = axis.inertia[MOTOR] * (1 - rotor) / rotor;
        axis.shaft = TWO_PI * hertz * TWO_PI * hertz * reduced;
        axis.damping = 2 * (is_known ? 0.01 : uniform(0.01, 0.03)) * sqrt(axis.shaft * reduced);
        axis.Fc[MOTOR] = share * Fc;
        axis.Fc[LOAD] = Fc - axis.Fc[MOTOR];
        axis.sigma0[MOTOR] = share * sigma0;
        axis.sigma0[LOAD] = sigma0 - axis.sigma0[MOTOR];
        if (is_known) { /* the worst */
            axis.params.gain = 0.94f;
            axis.params.slew = (float)(1000 * Fc);
            axis.params.noise = 0;
            axis.bits = 18;
        }
        /* the angle that the encoder sees, with the twist of the shaft */
        const double seen = length * (1 + (1 - share) * sigma0 / axis.shaft);
        set_bounds(&axis, Fc * (is_known ? 1 : uniform(0.7, 1)), seen * 1.000001, lengths);
        if (sigma0 < 100 * axis.shaft && axis.delay > 0 && is_play_short(&axis)) {
            return axis;
        }
    }
}

static int elastic_axis_swings(const axis_t *axis)
{
    const double Fc = axis->Fc[MOTOR] + axis->Fc[LOAD], sigma0 = axis->sigma0[MOTOR] + axis->sigma0[LOAD];
    const double V = Fc / sqrt(sigma0 * (axis->inertia[MOTOR] + axis->inertia[LOAD]));
    const push_t pushes[] = {{V, 0, 0}, {5 * V, 0, 0}, {30 * V, 0, 0}, {0, 3 * V, 0}, {0, 20 * V, 0}};
    return swings_after_any(axis, pushes, 5);
}

static void test_an_elastic_axis_rests_with_four_times_the_length(void)
{
    for (int k = 0; k < TEST_AXES / 2; k++) {
        axis_t axis = random_elastic_axis(4, k % 2);
        if (k % 4 == 0) {
            set_load(&axis, uniform(0.05, 0.6), uniform(0.7, 0.9499));
        }
        TEST_ASSERT_FALSE(elastic_axis_swings(&axis));
    }
}

static void test_an_elastic_axis_is_refused_with_less_and_can_swing(void)
{
    int swinging = 0;
    for (int k = 0; k < TEST_AXES / 2; k++) {
        axis_t axis = random_elastic_axis(1, 1);
        axis.params.elastic = 1;
        TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_SLOPE, code_of(&axis));
        axis.params.elastic = 0; /* false */
        swinging += elastic_axis_swings(&axis);
    }
    TEST_ASSERT_GREATER_THAN_INT(0, swinging);
}

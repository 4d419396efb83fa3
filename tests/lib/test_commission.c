/* SPDX-License-Identifier: MIT */
/* Commissioning of random axes: the bounds are true, the axis rests with them, and no fault moves it beyond its limits.
 * Build with -DTEST_AXES=300 to measure. */
#include <stdio.h>
#include <stdlib.h>
#include <unity.h>

#include "axis_checks.h"

#ifndef TEST_AXES
#define TEST_AXES 40
#endif
#define FIRST_AXIS 20000 /* no constant was set on these */
#ifndef FAULTY_AXES
#define FAULTY_AXES 8
#endif
#ifndef FLEXIBLE_AXES
#define FLEXIBLE_AXES 12
#endif
#define LUCK 2 /* axes that may fail more than the share allows, because few were tested */
#define LIMIT 10.0f
#define MOST_RAD 1.5 /* twice angle_limit: a frozen encoder, a hand, a load without a brake */

static int compare(const void *left, const void *right)
{
    double x = *(const double *)left, y = *(const double *)right;
    return (x > y) - (x < y);
}

static void test_bounds_of_random_axes(void)
{
    static double hands[TEST_AXES];
    int passed[LINES] = {0};
    for (int k = 0; k < TEST_AXES; k++) {
        axis_t axis = random_axis(FIRST_AXIS + (uint64_t)k);
        motion_t motion;
        dahl_commission_t state = commission_axis(&axis, &motion, 60);
        hands[k] = 1;
        if (state.command.stage == DAHL_COMMISSION_DONE) {
            count_axis(&axis, &state, passed);
            hands[k] = hand_torque_ratio(&axis, &state);
        }
    }
    qsort(hands, TEST_AXES, sizeof hands[0], compare);
    printf("%d axes, hand torque %.2f of that without compensation\n", TEST_AXES, hands[TEST_AXES / 2]);
    TEST_ASSERT_TRUE(hands[TEST_AXES / 2] < 0.34);
    for (int line = 0; line < LINES; line++) {
        int all = line == BOUNDS ? TEST_AXES : passed[BOUNDS];
        printf("  %s: %d of %d\n", lines[line].name, passed[line], all);
        TEST_ASSERT_TRUE_MESSAGE(passed[line] + LUCK >= lines[line].share * all, lines[line].name);
    }
}

/* Axes near the limits of the rules: each must pass every line. */
static void test_axes_at_the_edge_of_the_rules(void)
{
    static const uint64_t numbers[] = {
        1235,  /* the loop shakes it in the slow sweeps */
        40156, /* likewise */
        1116,  /* the loop amplifies the sines until the axis reverses */
        1068,  /* light: its inertia must have a narrow interval */
        30298, /* likewise */
        40153, /* creeps at 0.014 rad/s, with peaks above 0.02 */
    };
    for (size_t k = 0; k < sizeof numbers / sizeof numbers[0]; k++) {
        axis_t axis = random_axis(numbers[k]);
        motion_t motion;
        int passed[LINES] = {0};
        dahl_commission_t state = commission_axis(&axis, &motion, 60);
        TEST_ASSERT_EQUAL(DAHL_COMMISSION_OK, state.command.refusal);
        TEST_ASSERT_FALSE(state.result.elastic);
        count_axis(&axis, &state, passed);
        for (int line = BOUNDS; line < LINES; line++) {
            printf("  axis %d, %s: %d\n", (int)numbers[k], lines[line].name, passed[line]);
            TEST_ASSERT_TRUE(passed[line] || line == SECONDS || line == LOAD);
        }
    }
}

/* An inertia that is far too large makes the loop shake the axis: refused in the sweeps, with the code that names it. */
static void test_a_wrong_inertia_shakes_the_axis(void)
{
    axis_t axis = random_axis(FIRST_AXIS);
    motion_t motion;
    axis.loop_inertia *= 8;
    dahl_commission_t state = commission_axis(&axis, &motion, 60);
    printf("  code %d after %.1f s\n", state.command.refusal, motion.time);
    TEST_ASSERT_TRUE(state.command.refusal == DAHL_COMMISSION_VARIES || state.command.refusal == DAHL_COMMISSION_SPEED);
}

/* An axis with another encoder, tick, delay or travel is refused, or its bounds are true. */
static void test_bounds_of_other_axes(void)
{
    int passed[LINES] = {0};
    for (int k = 0; k < TEST_AXES / 2; k++) {
        axis_t axis = other_axis(FIRST_AXIS + (uint64_t)k);
        motion_t motion;
        dahl_commission_t state = commission_axis(&axis, &motion, 200);
        if (state.command.stage == DAHL_COMMISSION_DONE) {
            count_axis(&axis, &state, passed);
        }
    }
    printf("%d of %d other axes accepted\n", passed[BOUNDS], TEST_AXES / 2);
    TEST_ASSERT_TRUE(passed[BOUNDS] >= TEST_AXES / 3);
    for (int line = FC_LOW; line < LINES; line++) {
        printf("  %s: %d\n", lines[line].name, passed[line]);
        if (line != SECONDS) { /* a longer travel takes longer */
            TEST_ASSERT_TRUE_MESSAGE(passed[line] + LUCK >= lines[line].share * passed[BOUNDS], lines[line].name);
        }
    }
}

static void test_flexible_axes_rest_and_their_rotor_is_bounded(void)
{
    int accepted = 0, bounded = 0;
    for (int k = 0; k < FLEXIBLE_AXES; k++) {
        axis_t axis = flexible_axis(FIRST_AXIS + (uint64_t)k);
        int tries;
        dahl_commission_t state = commission_flexible(&axis, &tries);
        if (state.command.stage == DAHL_COMMISSION_DONE) {
            accepted++;
            bounded += bounds_rotor(&axis, &state.result);
            TEST_ASSERT_TRUE(rests(&axis, &state, 0));
        }
    }
    printf("%d of %d flexible axes accepted, %d have a bound of the rotor\n", accepted, FLEXIBLE_AXES, bounded);
    TEST_ASSERT_TRUE(accepted + LUCK >= 2 * FLEXIBLE_AXES / 3);
    TEST_ASSERT_TRUE(bounded + LUCK >= 0.95 * accepted);
}

/* The first sines leave the rotor too light for the compensator, or show no inertia. Faster ones show the rotor, so no softer
 * loop is needed. */
static void test_faster_sines_show_a_rotor(void)
{
    static const uint64_t light[] = {50004, 50115, 50269, 50433}, unseen[] = {50224, 50413};
    for (int k = 0; k < 6; k++) {
        const axis_t axis = flexible_axis(k < 4 ? light[k] : unseen[k - 4]);
        motion_t motion;
        const dahl_commission_t state = commission_axis(&axis, &motion, FLEXIBLE_SECONDS);
        TEST_ASSERT_EQUAL(DAHL_COMMISSION_OK, state.command.refusal);
        TEST_ASSERT_TRUE(state.result.elastic && bounds_rotor(&axis, &state.result) && rests(&axis, &state, 0));
        TEST_ASSERT_TRUE((double)state.result.gain < 0.51);
    }
}

/* This axis is flexible, but at no sine does its inertia differ by more than the error. */
static void test_faster_sines_lower_the_gain_also_if_no_shaft_shows(void)
{
    axis_t axis = flexible_axis(54105);
    int tries;
    const dahl_commission_t state = commission_flexible(&axis, &tries);
    TEST_ASSERT_EQUAL(DAHL_COMMISSION_DONE, state.command.stage);
    TEST_ASSERT_FALSE(state.result.elastic);
    TEST_ASSERT_FLOAT_WITHIN(1e-6f, 0.5f, state.result.gain);
    TEST_ASSERT_TRUE(rests(&axis, &state, 0));
}

/* --- faults ----------------------------------------------------------------------------------------------------------- */

/* The axis must be refused, or have true bounds, and it stays near its limits. */
static int check_fault(const axis_t *axis)
{
    motion_t motion;
    dahl_commission_t state = commission_axis(axis, &motion, 90);
    truth_t truth = truth_of(axis);
    printf("  code %d, %.2f rad, %.1f rad/s, %.1f s; Fc_low %.2f, length_long %.2f of the truth\n", state.command.refusal,
           motion.most_angle, motion.most_speed, motion.time, (double)state.result.Fc.least / truth.least,
           (double)state.result.length.most / truth.length);
    TEST_ASSERT_TRUE(state.command.stage >= DAHL_COMMISSION_DONE);
    TEST_ASSERT_EQUAL(DAHL_COMMISSION_OFF, state.command.mode);
    TEST_ASSERT_TRUE(motion.most_angle < MOST_RAD);
    if (state.command.stage == DAHL_COMMISSION_DONE) {
        TEST_ASSERT_TRUE((double)state.result.Fc.least <= 1.03 * truth.least);
        TEST_ASSERT_TRUE((double)state.result.length.most >= 0.97 * truth.length);
    }
    return state.command.refusal;
}

static void test_faults(void)
{
    for (int k = 0; k < FAULTY_AXES; k++) {
        const axis_t good = random_axis(FIRST_AXIS + (uint64_t)k);
        uint64_t seed = (uint64_t)k + 1;
        axis_t axis = good;
        axis.limit = uniform(&seed, 0.6, 1.2) * (good.Fc + good.gravity) / good.torque_constant;
        check_fault(&axis);
        axis = good;
        axis.freeze_at = uniform(&seed, 1, 20);
        check_fault(&axis);
        axis = good;
        axis.stop = uniform(&seed, 0.1, 0.3);
        check_fault(&axis);
        axis = good;
        axis.hand = uniform(&seed, 0.5, 2) * good.Fc;
        axis.hand_from = uniform(&seed, 0, 20);
        axis.hand_to = axis.hand_from + uniform(&seed, 0.5, 4);
        check_fault(&axis);
        axis = good; /* a load without a brake */
        axis.gravity = uniform(&seed, 1, 2) * good.Fc;
        check_fault(&axis);
        axis = good;
        axis.sign = -1;
        TEST_ASSERT_NOT_EQUAL(DAHL_COMMISSION_OK, check_fault(&axis));
    }
}

/* --- one call ----------------------------------------------------------------------------------------------------------- */

static const dahl_commission_config_t valid = {.period = 1e-3f,
                                               .theta_per_count = 1e-4f,
                                               .inertia = 0.002f,
                                               .travel = 0.35f,
                                               .angle_limit = 0.7f,
                                               .speed_limit = 10,
                                               .torque_limit = LIMIT};

static void test_rejects_each_bad_configuration(void)
{
    const float bad[] = {0, -1, INFINITY, -INFINITY, NAN};
    for (size_t field = 0; field < sizeof valid / sizeof(float); field++) {
        for (size_t k = 0; k < sizeof bad / sizeof bad[0]; k++) {
            dahl_commission_config_t config = valid;
            dahl_commission_t axis;
            dahl_commission_command_t command;
            memcpy((char *)&config + field * sizeof(float), &bad[k], sizeof(float));
            TEST_ASSERT_EQUAL(DAHL_COMMISSION_PARAM, dahl_commission_start(&axis, &config));
            TEST_ASSERT_EQUAL(DAHL_COMMISSION_REFUSED, dahl_commission_tick(&axis, 5, 1, &command));
            TEST_ASSERT_EQUAL(DAHL_COMMISSION_OFF, command.mode);
        }
    }
}

/* Otherwise the angle wraps before it reaches its limit. */
static void test_the_counts_hold_the_angle_limit(void)
{
    dahl_commission_config_t config = valid;
    dahl_commission_t axis;
    config.theta_per_count = 1e-9f;
    config.angle_limit = 1.9f;
    TEST_ASSERT_EQUAL(DAHL_COMMISSION_OK, dahl_commission_start(&axis, &config));
    config.angle_limit = 2.2f;
    TEST_ASSERT_EQUAL(DAHL_COMMISSION_PARAM, dahl_commission_start(&axis, &config));
}

/* Any counts and torques: the torque stays within its limit, and the end comes within the time-outs. */
static void test_any_input_ends_within_the_limits(void)
{
    for (uint64_t seed = 1; seed < 200; seed++) {
        uint64_t random = seed;
        dahl_commission_t axis;
        dahl_commission_command_t command = {0};
        TEST_ASSERT_EQUAL(DAHL_COMMISSION_OK, dahl_commission_start(&axis, &valid));
        long ticks = 0;
        int32_t range = (int32_t)(seed % 4 == 0 ? 1u << (seed % 31) : seed % 9);
        for (; ticks < 200000 && command.stage < DAHL_COMMISSION_DONE; ticks++) {
            int32_t moved = range == 0 ? 0 : (int32_t)(random_u32(&random) % (2u * (uint32_t)range + 1)) - range;
            float torque = seed % 3 == 0 ? command.torque : (float)uniform(&random, -1, 1);
            dahl_commission_tick(&axis, moved, seed == 5 && ticks == 300 ? NAN : torque, &command);
            TEST_ASSERT_TRUE(fabsf(command.torque) <= command.torque_limit && command.torque_limit <= LIMIT);
            TEST_ASSERT_TRUE(fabsf(command.angle) <= valid.angle_limit && fabsf(command.speed) <= valid.speed_limit);
            TEST_ASSERT_TRUE(isfinite(command.acceleration));
        }
        TEST_ASSERT_TRUE(ticks < 200000);
        TEST_ASSERT_EQUAL(DAHL_COMMISSION_OFF, command.mode);
        TEST_ASSERT_EQUAL_FLOAT(0, command.torque);
    }
}

static void test_abort_at_any_tick_and_no_change_after_the_end(void)
{
    for (int tick = 0; tick < 24000; tick += 997) {
        axis_t axis = random_axis(FIRST_AXIS);
        motion_t motion;
        dahl_commission_t state = commission_axis(&axis, &motion, tick * axis.period), before;
        dahl_commission_command_t command;
        int was_done = state.command.stage == DAHL_COMMISSION_DONE;
        dahl_commission_abort(&state);
        before = state;
        dahl_commission_tick(&state, 100, 1, &command);
        TEST_ASSERT_EQUAL_MEMORY(&before, &state, sizeof state);
        TEST_ASSERT_EQUAL(DAHL_COMMISSION_OFF, command.mode);
        TEST_ASSERT_EQUAL(was_done ? DAHL_COMMISSION_OK : DAHL_COMMISSION_ABORTED, command.refusal);
    }
}

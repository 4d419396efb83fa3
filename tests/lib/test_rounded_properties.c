/* SPDX-License-Identifier: MIT */
/* Properties that hold within the rounding of the state: energy, opposite motion, longer moves, the inverse. The bounds are those of
 * dahl_parts.h; plans, states and moves are random. */
#include <stdio.h>
#include <stdlib.h>
#include <unity.h>

#define HOLDS(condition, words) TEST_ASSERT_TRUE_MESSAGE(condition, words)
#include "properties.h"
#include "plans.h"

#ifndef TEST_TICKS
#define TEST_TICKS 200000
#endif

#define TIE ((uint32_t)1 << 31)

static motion_t m = MOTION_START;
static subject_t subject;
static set_t set;

static int has_kernel(const model_t *model)
{
    return model->by_angle || model->more == MORE_IS_BREAKAWAY;
}

static float random_mantissa(void)
{
    return 1.0f + (float)(motion_random(&m) >> 9) * 0x1p-23f;
}

/* A count travels 2^-29.9 to 1; the breakaway is near 0 to near 1; Fc forward and backward differ by up to 100. */
static void begin_any(const model_t *model)
{
    const float Fc = random_mantissa();
    const double least = model->more == MORE_IS_RATIO ? -22 : -29.9;
    set.p.Fc = Fc;
    set.p.sigma0 = (float)ldexp((double)Fc * pow(2.0, motion_random(&m) * -0x1p-32 * least + least), 20);
    set.p.theta_per_count = 0x1p-20f;
    set.more = model->more == MORE_IS_RATIO ? (float)pow(10.0, (int)(motion_random(&m) % 5u) - 2)
        : motion_random(&m) % 2               ? (float)pow(10.0, motion_random(&m) * 0x1p-32 * 9 - 9)
                                              : (float)(motion_random(&m) % 1000u + 1) / 1001.0f;
    TEST_ASSERT_TRUE_MESSAGE(subject_begin(&subject, model, &set), model->name);
}

/* w is the first member of every state here. */
static long double w_of(const any_state_t *state)
{
    return (long double)state->dahl.w * 0x1p-62L;
}

static stroke_t stroke_of(const model_t *model, move_t move, long double w0, long double w1)
{
    const long double theta = model->by_angle ? angle_of(&set, move) : (long double)move.counts * set.p.theta_per_count;
    const long double travel = fabsl(theta) * set.p.sigma0 / whole_of(model, &set);
    return (stroke_t){&set, theta < 0 ? -1 : 1, travel, move.load_q30 * 0x1p-30L, w0, w1};
}

static int32_t next_move(uint32_t kind, int t, int32_t amplitude)
{
    const int32_t to_and_fro = t % 2 ? -amplitude : amplitude;
    const int32_t walk = (int32_t)(motion_random(&m) % (2 * (uint32_t)amplitude + 1)) - amplitude;
    return kind == 0 ? to_and_fro : kind == 1 ? walk : t < 40 ? 1 : to_and_fro;
}

/* Return the least loss along the motion, as a fraction of Fc times its travel. */
static long double least_loss(const model_t *model)
{
    const uint32_t kind = motion_random(&m) % 3u;
    const int32_t amplitude = 1 << motion_random(&m) % 12u;
    move_t move = {0, ONE_Q30};
    long double loss = 0, way = 0, least = 0;
    for (int t = 0; t < 500; t++) {
        if (model->has_load != 0 && t % 20 == 0) {
            move.load_q30 = motion_random(&m) >> 1 >> motion_random(&m) % 20u | 1u;
        }
        (void)subject_step(&subject, &subject.state, 0, move.load_q30);
        const long double before = w_of(&subject.state);
        move.counts = next_move(kind, t, amplitude);
        (void)subject_step(&subject, &subject.state, move.counts, move.load_q30);
        const stroke_t stroke = stroke_of(model, move, before, w_of(&subject.state));
        loss += model->loss(&stroke);
        way += stroke.travel * (model->has_load != 0 ? fmaxl(stroke.load, 1) : 1);
        least = way > 0 ? fminl(least, loss / way) : least;
    }
    return least;
}

static void test_no_motion_makes_more_energy_than_its_rounding(void)
{
    for (size_t i = 0; i < MODELS; i++) {
        long double least = 0;
        if (models[i].loss == NULL) {
            continue;
        }
        for (int k = 0; k < TEST_TICKS / 200; k++) {
            begin_any(&models[i]);
            least = fminl(least, least_loss(&models[i]));
        }
        printf("%s: least loss %.2Le of Fc times the way\n", models[i].name, least);
        const double bound = has_kernel(&models[i]) ? DAHL_ENERGY_ERROR : DAHL_ENERGY_ERROR_COUNTS;
        TEST_ASSERT_TRUE_MESSAGE(least >= -(long double)bound, models[i].name);
    }
}

static any_state_t random_state(const model_t *model, uint32_t low, uint32_t load)
{
    any_state_t state = {{(int64_t)((uint64_t)(motion_random(&m) >> 1) << 32 | low) - ((int64_t)1 << 62)}};
    state.loaded.load_q30 = model->has_load == 1 ? load : 0;
    return state;
}

/* The sum of the states after a tick and after the opposite tick from the opposite state: 0 if they are opposite. Unit 2^-62. */
static int64_t asymmetry_of_tick(const model_t *model, uint32_t low)
{
    const uint32_t load = model->has_load != 0 ? motion_random(&m) >> 1 | 1u : ONE_Q30;
    const int32_t counts = (int32_t)(motion_random(&m) % 8u) + 1;
    any_state_t there = random_state(model, low, load), opposite = there;
    opposite.dahl.w = -there.dahl.w;
    (void)subject_step(&subject, &there, counts, load);
    (void)subject_step(&subject, &opposite, -counts, load);
    return there.dahl.w + opposite.dahl.w;
}

static void test_opposite_motion_is_opposite_except_at_ties(void)
{
    int64_t most = 0;
    for (size_t i = 0; i < MODELS; i++) {
        for (int k = 0; models[i].more != MORE_IS_RATIO && models[i].loss != NULL && k < TEST_TICKS / 10; k++) {
            begin_any(&models[i]);
            const uint32_t low = motion_random(&m);
            TEST_ASSERT_TRUE_MESSAGE(low == TIE || asymmetry_of_tick(&models[i], low) == 0, models[i].name);
            const int64_t at_tie = llabs(asymmetry_of_tick(&models[i], TIE));
            TEST_ASSERT_TRUE_MESSAGE(at_tie <= (int64_t)1 << 32, models[i].name); /* 2^-30 of Fc */
            most = at_tie > most ? at_tie : most;
        }
    }
    TEST_ASSERT_TRUE(most > (int64_t)1 << 30);
}

/* How far a longer move ends short of a shorter one, in Fc. */
static long double fall_of_longer_move(const model_t *model)
{
    const uint32_t load = model->has_load != 0 ? motion_random(&m) >> 1 | 1u : ONE_Q30;
    for (int k = 0; k < 3; k++) {
        (void)subject_step(&subject, &subject.state, motion_leap(&m), load);
    }
    const any_state_t start = subject.state;
    const int32_t s = motion_random(&m) & 64u ? 1 : -1, n = (int32_t)(motion_random(&m) >> 2 >> motion_random(&m) % 29u);
    long double before = -2, fall = 0;
    for (int32_t k = 0; k < 30; k++) {
        any_state_t state = start;
        (void)subject_step(&subject, &state, s * (n + k), load);
        fall = fmaxl(fall, before - s * w_of(&state));
        before = fmaxl(before, s * w_of(&state));
    }
    return fall * (model->has_load != 0 ? load * 0x1p-30L : 1);
}

static void test_a_longer_move_falls_short_by_its_rounding_at_most(void)
{
    for (size_t i = 0; i < MODELS; i++) {
        long double most = 0;
        if (models[i].loss == NULL || models[i].by_angle) {
            continue;
        }
        for (int k = 0; k < TEST_TICKS / 10; k++) {
            begin_any(&models[i]);
            most = fmaxl(most, fall_of_longer_move(&models[i]));
        }
        printf("%s: a longer move ends up to %.2Le of Fc short\n", models[i].name, most);
        TEST_ASSERT_TRUE_MESSAGE(most <= (long double)DAHL_MONOTONE_ERROR, models[i].name);
    }
}

static float step_from_rest(const dahl_plan_t *plan, int32_t dcounts)
{
    dahl_state_t state = {0};
    return dahl_step_counts(plan, &state, dcounts);
}

/* A shorter move may reach F within the rounding only. Return how much shorter it is. */
static int32_t check_shorter(const dahl_plan_t *plan, const dahl_params_t *p, float F, int32_t found, int32_t counts)
{
    const float reached = step_from_rest(plan, counts);
    if (reached < F) {
        return 0;
    }
    TEST_ASSERT_TRUE(((long double)reached - F) / p->Fc <= (long double)DAHL_INVERSE_ERROR + 0.51L * ulp_of(reached) / p->Fc);
    return found - counts;
}

/* From rest to Fc less a few floats, where rounding reorders the moves. The gap to Fc is at least 2^-25, as in the header. */
static void test_a_shorter_move_reaches_the_torque_within_rounding_only(void)
{
    const dahl_params_t p = params_for(1e-5, 1.0f);
    const dahl_plan_t plan = plan_for(&p);
    const dahl_state_t rest = {0};
    int32_t most = 0;
    for (int floats = 0; floats < 8; floats++) {
        const float F = p.Fc - (float)floats * 0x1p-24f;
        const long double gap = fmaxl(1 - (long double)F, 0x1p-25L), earlier = DAHL_INVERSE_ERROR / (1e-5L * gap);
        int32_t found = 0;
        TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_counts_to_torque(&plan, &rest, F, &found));
        for (int32_t i = 1; i <= (TEST_TICKS / 50); i++) {
            const int32_t next = check_shorter(&plan, &p, F, found, found - i);
            const int32_t any = check_shorter(&plan, &p, F, found, (int32_t)(motion_random(&m) % (uint32_t)found));
            most = next > most ? next : most;
            TEST_ASSERT_TRUE(next <= 1 + earlier && any <= 1 + earlier);
        }
    }
    TEST_ASSERT_TRUE(most > 300);
}

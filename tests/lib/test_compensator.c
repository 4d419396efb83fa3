/* SPDX-License-Identifier: MIT */
/* dahl_compensator.h: checks of the parameters, plans against their formulas in double, ticks of random motions against a
 * model, and any bits as a state. */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

#include "../random.h"
#include "dahl_compensator.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif
#define PLANS (TEST_TICKS < 20000 ? 500 : 20000)

#define ONE_Q30 (1 << 30)
#define FROM_Q20 0x1p-20
#define FROM_Q30 0x1p-30

static uint64_t seed;

void setUp(void)
{
    seed = 1;
}

static const dahl_compensator_params_t valid = {
    .friction = {100.0f, 0.5f, 3.8349519e-4f},
    .law = DAHL_COMPENSATOR_REFERENCE,
    .Fc_low = 0.5f,
    .length_long = 0.005f,
    .sigma0_high = 100.0f, /* this and the next two: of the measured law */
    .inertia = 0.002f,
    .delay = 3e-3f,
    .gain = 1.0f,
    .limit = 0.5f,
    .slew = 1e6f,
    .period = 1e-3f,
    .noise = 1,
    .play = 2,
    .jump = 100,
};

/* With the measured law and a gain that it may have. */
static dahl_compensator_params_t measured_params(void)
{
    dahl_compensator_params_t params = valid;
    params.law = DAHL_COMPENSATOR_MEASURED;
    params.gain = 0.9f;
    return params;
}

static dahl_compensator_plan_t plan_of(const dahl_compensator_params_t *params)
{
    dahl_compensator_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_compensator_prepare(&plan, params));
    return plan;
}

/* Any size, either sign. */
static int32_t random_i32(void)
{
    const int32_t any = (int32_t)random_u32(&seed);
    return any >> (random_u32(&seed) & 31u);
}

/* The logarithm is uniform. */
static double random_between(double least, double most)
{
    return least * pow(most / least, random_u32(&seed) * 0x1p-32);
}

static double clamp(double x, double most)
{
    return fmax(-most, fmin(most, x));
}

/* --- parameters ------------------------------------------------------------------------------------------------------- */

#define AT(member) offsetof(dahl_compensator_params_t, member)

typedef struct {
    size_t member; /* of a float */
    float value;
    dahl_compensator_err_t code;
} refusal_t;

static void check_refusals(const dahl_compensator_params_t *good, const refusal_t *cases, size_t count)
{
    for (size_t k = 0; k < count; k++) {
        dahl_compensator_params_t params = *good;
        dahl_compensator_plan_t plan = {.gain_q16 = 77}, before = plan;
        memcpy((char *)&params + cases[k].member, &cases[k].value, sizeof(float));
        TEST_ASSERT_EQUAL_INT(cases[k].code, dahl_compensator_prepare(&plan, &params));
        TEST_ASSERT_TRUE((cases[k].code == DAHL_COMPENSATOR_OK) == (memcmp(&plan, &before, sizeof plan) != 0));
    }
}

static void test_parameters_are_refused_with_the_code_of_their_bound(void)
{
    static const refusal_t cases[] = {
        {AT(friction.sigma0), 0.0f, DAHL_COMPENSATOR_PARAM},
        {AT(friction.theta_per_count), 0.0f, DAHL_COMPENSATOR_PARAM},
        {AT(friction.Fc), 0x1p-70f, DAHL_COMPENSATOR_RANGE},
        {AT(Fc_low), -1.0f, DAHL_COMPENSATOR_PARAM},
        {AT(length_long), -1.0f, DAHL_COMPENSATOR_PARAM},
        {AT(gain), -0.5f, DAHL_COMPENSATOR_PARAM},
        {AT(gain), 1.0000001f, DAHL_COMPENSATOR_RANGE},
        {AT(limit), 0.0f, DAHL_COMPENSATOR_PARAM},
        {AT(slew), 0.0f, DAHL_COMPENSATOR_PARAM},
        {AT(period), NAN, DAHL_COMPENSATOR_PARAM},
        {AT(rise), INFINITY, DAHL_COMPENSATOR_PARAM},
        {AT(fall), 0x1p64f, DAHL_COMPENSATOR_RANGE},
        {AT(rise), 0x1p-65f, DAHL_COMPENSATOR_RANGE},
        {AT(fade_speed), -1.0f, DAHL_COMPENSATOR_PARAM},
        {AT(fade_speed), 0.0383495130f, DAHL_COMPENSATOR_RANGE}, /* jump is 1000 times this speed */
        {AT(fade_speed), 0.0383495167f, DAHL_COMPENSATOR_OK}, /* the next float */
        {AT(slew), 0x1p-32f, DAHL_COMPENSATOR_RANGE}, /* in a tick, less than 2^-30 Fc */
        {AT(fade_speed), -0.0f, DAHL_COMPENSATOR_OK},
        {AT(Fc_low), 0.49999997f, DAHL_COMPENSATOR_GAIN},
        {AT(friction.Fc), 0.50000006f, DAHL_COMPENSATOR_GAIN},
        {AT(length_long), 0.0050000004f, DAHL_COMPENSATOR_OK}, /* the next float: Fc/length_long may round up */
        {AT(length_long), 0.005000001f, DAHL_COMPENSATOR_SLOPE},
        {AT(friction.sigma0), 100.00002f, DAHL_COMPENSATOR_SLOPE},
        {AT(length_long), 0.004999999f, DAHL_COMPENSATOR_OK},
        {AT(gain), 0.0f, DAHL_COMPENSATOR_OK},
    };
    check_refusals(&valid, cases, sizeof cases / sizeof cases[0]);
}

/* The rules of a free axis, each next to its limit: 3.5 ms between reading and torque. test_compensator.py compares them with
 * exact fractions. */
static void test_the_measured_law_needs_a_stable_axis(void)
{
    static const refusal_t cases[] = {
        {AT(sigma0_high), 0.0f, DAHL_COMPENSATOR_PARAM},
        {AT(inertia), 0.0f, DAHL_COMPENSATOR_PARAM},
        {AT(delay), 0.0f, DAHL_COMPENSATOR_PARAM},
        {AT(load), -1.0f, DAHL_COMPENSATOR_PARAM},
        {AT(load), 0x1p-65f, DAHL_COMPENSATOR_RANGE},
        {AT(gain), 0.95f, DAHL_COMPENSATOR_OK}, /* a float below 0.95 */
        {AT(gain), 0.95000005f, DAHL_COMPENSATOR_GAIN},
        {AT(load), 0.026f, DAHL_COMPENSATOR_OK},
        {AT(load), 0.027f, DAHL_COMPENSATOR_GAIN},
        {AT(load), 0.5f, DAHL_COMPENSATOR_GAIN},
        {AT(load), 1e9f, DAHL_COMPENSATOR_GAIN},
        {AT(inertia), 4.084e-4f, DAHL_COMPENSATOR_OK},
        {AT(inertia), 4.083e-4f, DAHL_COMPENSATOR_INERTIA},
        {AT(delay), 7.24e-3f, DAHL_COMPENSATOR_OK},
        {AT(delay), 7.25e-3f, DAHL_COMPENSATOR_INERTIA},
        {AT(sigma0_high), 489.0f, DAHL_COMPENSATOR_OK},
        {AT(sigma0_high), 490.0f, DAHL_COMPENSATOR_INERTIA},
        {AT(length_long), 0.005000001f, DAHL_COMPENSATOR_SLOPE},
    };
    static const refusal_t elastic[] = {
        {AT(length_long), 0.00125f, DAHL_COMPENSATOR_OK},
        {AT(length_long), 0.0012500005f, DAHL_COMPENSATOR_SLOPE},
    };
    dahl_compensator_params_t params = measured_params();
    check_refusals(&params, cases, sizeof cases / sizeof cases[0]);
    params.elastic = 1;
    check_refusals(&params, elastic, sizeof elastic / sizeof elastic[0]);
    params.gain = 0.0f; /* no torque */
    params.length_long = 0.001f;
    params.load = 1.0f;
    (void)plan_of(&params);
    params = measured_params();
    params.load = 0x1p-64f;
    params.Fc_low = 0x1p62f; /* the load is below each bit of it */
    (void)plan_of(&params);
}

static void test_the_reference_law_ignores_the_axis(void)
{
    dahl_compensator_params_t params = valid;
    params.sigma0_high = params.inertia = params.delay = params.load = NAN;
    params.elastic = 1;
    (void)plan_of(&params);
}

/* A user may return the first code that is not 0. */
static void test_no_code_is_one_of_dahl_prepare(void)
{
    for (int code = DAHL_COMPENSATOR_INERTIA; code <= DAHL_COMPENSATOR_PARAM; code++) {
        TEST_ASSERT_TRUE(code != DAHL_OK && code != DAHL_ERR_PARAM && code != DAHL_ERR_RANGE);
    }
}

static void test_counts_and_laws_are_refused_with_the_code_of_their_bound(void)
{
    static const struct {
        uint32_t noise, play, jump;
        int law;
        float Fc_low; /* 0 skips both bounds, which the reference law alone may */
        dahl_compensator_err_t code;
    } cases[] = {
        {1, 1, 9, DAHL_COMPENSATOR_MEASURED, 0.5f, DAHL_COMPENSATOR_PLAY},
        {0, 0, 9, DAHL_COMPENSATOR_MEASURED, 0.5f, DAHL_COMPENSATOR_PLAY},
        {5, 9, 9, DAHL_COMPENSATOR_MEASURED, 0.5f, DAHL_COMPENSATOR_PLAY},
        {5, 10, 9, DAHL_COMPENSATOR_MEASURED, 0.5f, DAHL_COMPENSATOR_OK},
        {0, 1, 0, DAHL_COMPENSATOR_MEASURED, 0.5f, DAHL_COMPENSATOR_PARAM},
        {0, DAHL_COMPENSATOR_PLAY_MAX, 9, DAHL_COMPENSATOR_MEASURED, 0.5f, DAHL_COMPENSATOR_OK},
        {0, DAHL_COMPENSATOR_PLAY_MAX + 1, 9, DAHL_COMPENSATOR_MEASURED, 0.5f, DAHL_COMPENSATOR_RANGE},
        {UINT32_MAX, 4, 9, DAHL_COMPENSATOR_MEASURED, 0.5f, DAHL_COMPENSATOR_RANGE},
        {0, 1, DAHL_COMPENSATOR_JUMP_MAX, DAHL_COMPENSATOR_MEASURED, 0.5f, DAHL_COMPENSATOR_OK},
        {0, 1, DAHL_COMPENSATOR_JUMP_MAX + 1, DAHL_COMPENSATOR_MEASURED, 0.5f, DAHL_COMPENSATOR_RANGE},
        {0, 1, 9, DAHL_COMPENSATOR_MEASURED, 0.0f, DAHL_COMPENSATOR_PARAM},
        {0, 1, 9, DAHL_COMPENSATOR_REFERENCE, 0.0f, DAHL_COMPENSATOR_OK},
        {0, 1, 9, DAHL_COMPENSATOR_REFERENCE, 0.4f, DAHL_COMPENSATOR_GAIN},
        {0, 1, 9, 3, 0.5f, DAHL_COMPENSATOR_PARAM},
    };
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        dahl_compensator_params_t params = valid;
        dahl_compensator_plan_t plan;
        params.law = (dahl_compensator_law_t)cases[k].law;
        params.gain = 0.9f;
        params.Fc_low = cases[k].Fc_low;
        params.length_long *= cases[k].Fc_low > 0 ? 1 : 0;
        params.noise = cases[k].noise;
        params.play = cases[k].play;
        params.jump = cases[k].jump;
        TEST_ASSERT_EQUAL_INT(cases[k].code, dahl_compensator_prepare(&plan, &params));
    }
    dahl_compensator_params_t fast = valid; /* a fade so late that no jump is near it */
    fast.fade_speed = 1e18f;
    fast.jump = DAHL_COMPENSATOR_JUMP_MAX - 1;
    dahl_compensator_plan_t plan = plan_of(&fast);
    fast.jump = DAHL_COMPENSATOR_JUMP_MAX;
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_RANGE, dahl_compensator_prepare(&plan, &fast));
}

/* --- plans ------------------------------------------------------------------------------------------------------------ */

/* The value is rounded down, and saturates. It may lose a unit more, or 2^-30 of itself. */
static void check_fixed(double exact, double least, double most, double fixed)
{
    const double wanted = fmax(least, fmin(most, exact));
    TEST_ASSERT_DOUBLE_WITHIN(1 + wanted * 0x1p-30, wanted, fixed);
}

/* The longest power of two of ticks within a time, at most 2^most. */
static int doublings(double seconds, double period, int most)
{
    const int shift = (int)floor(log2(seconds / period));
    return shift < 0 ? 0 : shift > most ? most : shift;
}

static double fade_step(double period, double seconds)
{
    return seconds > 0 ? period / seconds * ONE_Q30 : ONE_Q30;
}

/* Random parameters: 0 switches a term off in one of eight cases. */
static dahl_compensator_params_t random_params(void)
{
    dahl_compensator_params_t params = valid;
    params.Fc_low = params.length_long = 0.0f;
    params.friction.Fc = (float)random_between(1e-3, 1e3);
    params.friction.theta_per_count = (float)ldexp(6.2831853, -12 - (int)(random_u32(&seed) % 19));
    params.friction.sigma0 = params.friction.Fc * (float)random_between(1, 1e3);
    params.period = (float)random_between(2e-6, 2e-2);
    params.gain = (float)(random_u32(&seed) % 1001) / 1000.0f;
    params.limit = (float)random_between(1e-12, 1e9);
    params.slew = (float)random_between(1e-9, 1e12);
    float *const optional[] = {&params.rise, &params.fall, &params.fade_speed};
    static const double most[] = {1e7, 1e7, 1e4};
    for (size_t k = 0; k < sizeof optional / sizeof optional[0]; k++) {
        *optional[k] = random_u32(&seed) % 8 == 0 ? 0.0f : (float)random_between(1e-5, most[k]);
    }
    params.jump = (uint32_t)random_between(1, 1e9);
    return params;
}

/* A unit of few bits is rounded up, so that a fine encoder does not fade late. */
static void check_speed_unit(const dahl_compensator_plan_t *plan, double counts_to_fade)
{
    const double unit = counts_to_fade > 0 ? 1 / (counts_to_fade * FROM_Q20) : 0;
    check_fixed(unit, 0, ONE_Q30, plan->speed_unit);
    TEST_ASSERT_TRUE(counts_to_fade <= DAHL_COMPENSATOR_FINE_COUNTS || plan->speed_unit >= unit);
}

/* Within 1e-9 of the limit, a double does not decide it. */
static void check_jump(double jump, double counts_to_fade, int is_accepted)
{
    const double factor = DAHL_COMPENSATOR_JUMP_SPEEDS / (counts_to_fade > DAHL_COMPENSATOR_FINE_COUNTS ? 2.0 : 1.0);
    const double part = counts_to_fade > 0 ? jump / (factor * counts_to_fade) : 0;
    TEST_ASSERT_TRUE(is_accepted ? part < 1 + 1e-9 : part > 1 - 1e-9);
}

static void test_a_plan_has_the_values_of_its_parameters(void)
{
    int accepted = 0;
    for (int k = 0; k < PLANS; k++) {
        const dahl_compensator_params_t p = random_params();
        const double Fc = (double)p.friction.Fc, period = (double)p.period;
        const double counts_to_fade = (double)p.fade_speed * period / (double)p.friction.theta_per_count;
        dahl_compensator_plan_t plan;
        const int is_accepted = dahl_compensator_prepare(&plan, &p) == DAHL_COMPENSATOR_OK;
        const double slew = (double)p.slew * period / Fc * ONE_Q30;
        if (slew < 2 - 1e-9) { /* a unit is for dahl_compensator_change() */
            TEST_ASSERT_FALSE(is_accepted);
            continue;
        }
        check_jump(p.jump, counts_to_fade, is_accepted);
        if (!is_accepted) {
            continue;
        }
        accepted++;
        TEST_ASSERT_TRUE((uint64_t)plan.jump * plan.speed_unit < ONE_Q30);
        TEST_ASSERT_EQUAL_UINT32((uint32_t)((double)p.gain * 65536), plan.gain_q16);
        check_fixed((double)p.limit / Fc * ONE_Q30, 0, INT32_MAX, plan.limit_q30);
        check_fixed(slew - 1, 1, UINT32_MAX - 1.0, plan.slew_q30);
        TEST_ASSERT_TRUE(plan.slew_q30 <= slew - 1);
        check_fixed(fade_step(period, (double)p.rise), 1, ONE_Q30, plan.rise_q30);
        check_fixed(fade_step(period, (double)p.fall), 1, ONE_Q30, plan.fall_q30);
        check_speed_unit(&plan, counts_to_fade);
        TEST_ASSERT_EQUAL_INT(doublings((double)0.012f, period, 12), plan.speed_shift);
        TEST_ASSERT_EQUAL_UINT32((1u << plan.speed_shift) - 1, plan.speed_mask);
        TEST_ASSERT_TRUE(plan.slew_q30 >= 1 && plan.rise_q30 >= 1 && plan.fall_q30 >= 1);
        TEST_ASSERT_TRUE(plan.jump == p.jump && plan.play == (int32_t)p.play && plan.law == (uint8_t)p.law);
    }
    TEST_ASSERT_GREATER_THAN_INT(PLANS / 10, accepted);
}

/* --- ticks ------------------------------------------------------------------------------------------------------------ */

/* Speed, play and bad readings as the header defines them. */
typedef struct {
    int64_t position, speed_q20, bad_ticks, rejected;
    double fade, torque_q30;
    int was_bad; /* the last reading */
} model_t;

/* Return the part of a move that leaves the play. */
static int64_t model_play(model_t *model, const dahl_compensator_plan_t *plan, int32_t dcounts)
{
    const int64_t position = model->position + dcounts;
    model->position = position < 0 ? 0 : position > plan->play ? plan->play : position;
    return position - model->position;
}

static int32_t model_move(model_t *model, const dahl_compensator_plan_t *plan, int32_t dcounts, int is_good)
{
    const int is_bad = !is_good || llabs((int64_t)dcounts) > plan->jump, is_unused = is_bad || model->was_bad;
    const int64_t move = is_bad ? 0 : model_play(model, plan, dcounts);
    model->was_bad = is_bad;
    model->bad_ticks += is_bad;
    model->rejected += is_bad;
    if (is_unused) {
        model->fade -= model->bad_ticks < DAHL_COMPENSATOR_BAD_TICKS ? 0 : plan->fall_q30 * FROM_Q30;
        model->fade = fmax(0, model->fade);
        return 0;
    }
    model->speed_q20 += (move * plan->speed_unit - model->speed_q20) / ((int64_t)1 << plan->speed_shift);
    model->fade = fmin(1, model->fade + plan->rise_q30 * FROM_Q30);
    model->bad_ticks = 0;
    return (int32_t)move;
}

static void check_move(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator, model_t *model, int32_t dcounts)
{
    const int is_good = random_u32(&seed) % 64 > model->bad_ticks % 16;
    const int32_t move = model_move(model, plan, dcounts, is_good);
    TEST_ASSERT_EQUAL_INT32(move, dahl_compensator_move(plan, compensator, dcounts, is_good));
    TEST_ASSERT_EQUAL_INT32(move, compensator->move);
    TEST_ASSERT_EQUAL_INT32(model->position, compensator->play_position);
    TEST_ASSERT_EQUAL_INT32(model->speed_q20, compensator->speed_q20);
    TEST_ASSERT_EQUAL_UINT32(model->bad_ticks, compensator->bad_ticks);
    TEST_ASSERT_EQUAL_UINT32(model->rejected, compensator->rejected);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, model->fade, compensator->fade_q30 * FROM_Q30);
}

static void check_torque(const dahl_compensator_plan_t *plan, dahl_compensator_t *compensator, model_t *model, double gain,
                         int32_t ratio)
{
    const double speed_fade = fmax(0, fmin(1, 2 - fabs((double)model->speed_q20 * FROM_Q20)));
    const double wanted = ratio * gain * model->fade * speed_fade, slew = plan->slew_q30;
    const int32_t torque = dahl_compensator_torque(plan, compensator, ratio);
    TEST_ASSERT_DOUBLE_WITHIN(fabs(DAHL_COMPENSATOR_ERROR * ratio) + 1, wanted, compensator->wanted_q30);
    TEST_ASSERT_TRUE(fabs(wanted) > fabs((double)compensator->wanted_q30) - 1);
    TEST_ASSERT_TRUE(fabs(wanted) < fabs((double)ratio) || ratio == INT32_MIN || compensator->wanted_q30 == ratio);
    TEST_ASSERT_DOUBLE_WITHIN(0x1p-15, speed_fade, compensator->speed_fade_q15 * 0x1p-15);
    model->torque_q30 += clamp(compensator->wanted_q30 - model->torque_q30, slew);
    model->torque_q30 = clamp(model->torque_q30, plan->limit_q30);
    TEST_ASSERT_EQUAL_INT32((int32_t)model->torque_q30, torque);
    TEST_ASSERT_TRUE(compensator->torque_q30 == torque && compensator->ratio_q30 == ratio);
}

/* Motions of a few counts with jumps of any size, next to the longest ones too. */
static int32_t random_counts(const dahl_compensator_plan_t *plan, int t)
{
    const uint32_t kind = random_u32(&seed) % 32;
    const int32_t jump = (int32_t)plan->jump + (int32_t)(random_u32(&seed) % 3) - 1;
    const int32_t slide = t / 200 % 3 == 0 ? 0 : t / 200 % 3 == 1 ? 3 : -40;
    return kind == 0 ? random_i32() : kind == 1 ? jump : kind == 2 ? -jump : slide + (int32_t)(random_u32(&seed) % 13) - 6;
}

static void test_ticks_of_random_motions_follow_the_model(void)
{
    for (int k = 0; k < 200; k++) {
        dahl_compensator_params_t params = valid;
        params.gain = k % 4 == 0 ? 1.0f : (float)(k % 101) / 100.0f;
        params.noise = (uint32_t)k % 20;
        params.play = 2 * params.noise + (uint32_t)(k % 3) + (k % 20 == 0);
        params.jump = 60 + (uint32_t)k;
        params.limit = k % 3 == 0 ? 100.0f : (float)random_between(0.1, 1);
        params.slew = k % 2 == 0 ? 1e6f : (float)random_between(1, 1000);
        params.rise = k % 5 == 0 ? 0.0f : (float)random_between(1e-3, 0.1);
        params.fall = k % 7 == 0 ? 0.0f : (float)random_between(1e-3, 0.01);
        params.fade_speed = k % 3 == 0 ? 0.0f : 2.0f + (float)(k % 11);
        params.period = k % 10 == 9 ? 4e-6f : 1e-3f; /* the longest mean */
        params.fade_speed *= 1e-3f / params.period;
        const dahl_compensator_plan_t plan = plan_of(&params);
        dahl_compensator_t compensator = {0};
        model_t model = {0};
        for (int t = 0; t < 1000; t++) {
            check_move(&plan, &compensator, &model, random_counts(&plan, t));
            check_torque(&plan, &compensator, &model, (double)params.gain, random_i32());
        }
    }
}

/* The worst of a search over gain and both fades. All three are just below a step of their rounding. */
static void test_the_bound_of_rounding_is_reached_within_2_percent(void)
{
    dahl_compensator_params_t params = valid;
    params.gain = nextafterf(65359 / 65536.0f, 0);
    const dahl_compensator_plan_t plan = plan_of(&params);
    const int32_t left_q20 = (32709 << 5) - 1, fade_q30 = (32585 << 15) - 1;
    const double exact = (double)params.gain * fade_q30 * left_q20 * FROM_Q20;
    static const int32_t ratios[] = {-ONE_Q30, ONE_Q30};
    for (int k = 0; k < 2; k++) {
        dahl_compensator_t compensator = {.fade_q30 = (uint32_t)fade_q30, .speed_q20 = (2 << 20) - left_q20};
        (void)dahl_compensator_torque(&plan, &compensator, ratios[k]);
        const double error = (exact - abs(compensator.wanted_q30)) * FROM_Q30;
        TEST_ASSERT_TRUE(0.98 * DAHL_COMPENSATOR_ERROR < error && error < DAHL_COMPENSATOR_ERROR);
    }
}

/* Readings of a shaft that turns by 5 counts a tick: B is flagged, J is an unflagged jump of 200 counts. The play is 1: a move
 * back from a wrong count costs 1 count. The fade is at once: 0 is out. */
static void test_a_move_is_used_only_between_good_readings(void)
{
    static const struct {
        const char *readings, *fade;
        const char *moves[2]; /* bad readings are not passed to dahl_encoder_move(), or passed */
    } cases[] = {
        {"GGGG", "1111", {"5555", "5555"}},
        {"GBGG", "1111", {"5005", "5004"}},
        {"GJGGG", "11111", {"50005", "50005"}}, /* the way back is a jump too */
        {"BGGG", "1111", {"0055", "0045"}},
        {"GBBGG", "11111", {"50005", "50004"}},
        {"GBBBGG", "111001", {"500005", "500004"}},
        {"GBGBGBGG", "11111001", {"50000005", "50000004"}},
        {"GBGGBGGBGG", "1111111111", {"5005005005", "5004004004"}},
        {"GBBGBBGG", "11110001", {"50000005", "50000004"}},
    };
    dahl_compensator_params_t params = valid;
    params.noise = 0;
    params.play = 1;
    const dahl_compensator_plan_t plan = plan_of(&params);
    for (size_t k = 0; k < 2 * sizeof cases / sizeof cases[0]; k++) {
        const char *readings = cases[k / 2].readings, *moves = cases[k / 2].moves[k % 2];
        dahl_compensator_t compensator = {.play_position = 1, .fade_q30 = ONE_Q30};
        for (int t = 0, last = 0; readings[t] != 0; t++) {
            const int reading = 5 * (t + 1) + (readings[t] == 'J' ? 200 : readings[t] == 'B' ? 60 : 0);
            const int is_good = readings[t] != 'B', is_read = is_good || k % 2;
            const int32_t move = dahl_compensator_move(&plan, &compensator, is_read ? reading - last : 0, is_good);
            last = is_read ? reading : last;
            TEST_ASSERT_EQUAL_INT_MESSAGE(moves[t] - '0', move, readings);
            TEST_ASSERT_EQUAL_INT_MESSAGE(cases[k / 2].fade[t] - '0', compensator.fade_q30 >> 30, readings);
        }
    }
}

/* --- any bits --------------------------------------------------------------------------------------------------------- */

static void randomize(void *memory, size_t bytes)
{
    for (size_t k = 0; k < bytes; k++) {
        ((unsigned char *)memory)[k] = (unsigned char)random_u32(&seed);
    }
}

static void test_any_state_keeps_the_limit(void)
{
    dahl_compensator_params_t params = valid;
    params.limit = 0.3f;
    params.slew = 3.0f;
    const dahl_compensator_plan_t plan = plan_of(&params), zeros = {0};
    for (int k = 0; k < 20000; k++) {
        dahl_compensator_t compensator;
        randomize(&compensator, sizeof compensator);
        for (int t = 0; t < 4; t++) {
            (void)dahl_compensator_move(&plan, &compensator, random_i32(), (int)(random_u32(&seed) % 8));
            TEST_ASSERT_TRUE(labs(dahl_compensator_torque(&plan, &compensator, random_i32())) <= plan.limit_q30);
        }
        TEST_ASSERT_EQUAL_INT32(0, dahl_compensator_torque(&zeros, &compensator, random_i32()));
    }
}

/* With equal plans nothing changes, and with a plan of zeros no torque is left. */
static void test_a_change_of_any_state_keeps_the_limit(void)
{
    static const dahl_compensator_plan_t zeros = {0};
    for (int k = 0; k < PLANS; k++) {
        dahl_compensator_params_t params[2];
        dahl_compensator_plan_t plan[2];
        dahl_compensator_t compensator, before;
        for (int one = 0; one < 2; one++) {
            do {
                params[one] = random_params();
                params[one].play = 2 + random_u32(&seed) % 1000;
            } while (dahl_compensator_prepare(&plan[one], &params[one]) != DAHL_COMPENSATOR_OK);
        }
        randomize(&compensator, sizeof compensator);
        dahl_compensator_change(&plan[0], &plan[1], &compensator);
        TEST_ASSERT_TRUE(0 <= compensator.play_position && compensator.play_position <= plan[1].play);
        (void)dahl_compensator_move(&plan[1], &compensator, random_i32(), 1);
        TEST_ASSERT_TRUE(labs(dahl_compensator_torque(&plan[1], &compensator, random_i32())) <= plan[1].limit_q30);
        before = compensator;
        dahl_compensator_change(&plan[1], &plan[1], &compensator);
        TEST_ASSERT_EQUAL_MEMORY(&before, &compensator, sizeof before);
        dahl_compensator_change(&plan[1], &zeros, &compensator);
        TEST_ASSERT_EQUAL_INT32(0, compensator.torque_q30);
    }
}

/* A torque of the smallest Fc is none of the largest, and one of the largest is beyond each limit of the smallest. */
static void test_a_change_between_the_smallest_and_the_largest_Fc(void)
{
    static const dahl_compensator_plan_t zeros = {0};
    dahl_compensator_plan_t plan[2];
    for (int k = 0; k < 2; k++) {
        dahl_compensator_params_t params = valid;
        params.friction.Fc = k == 0 ? 0x1p-40f : 0x1p40f;
        params.friction.sigma0 = 200.0f * params.friction.Fc;
        params.Fc_low = params.limit = params.friction.Fc;
        params.slew = params.friction.Fc;
        plan[k] = plan_of(&params);
    }
    dahl_compensator_t compensator = {.torque_q30 = 1 << 30};
    dahl_compensator_change(&plan[0], &plan[1], &compensator);
    TEST_ASSERT_EQUAL_INT32(0, compensator.torque_q30);
    compensator.torque_q30 = -(1 << 20);
    dahl_compensator_change(&plan[1], &plan[0], &compensator); /* ratio and wanted are 0, and stay so */
    TEST_ASSERT_TRUE(compensator.torque_q30 <= -plan[0].limit_q30 && compensator.ratio_q30 == 0);
    TEST_ASSERT_EQUAL_INT32(-plan[0].limit_q30, dahl_compensator_torque(&plan[0], &compensator, -(1 << 30)));
    dahl_compensator_change(&zeros, &plan[1], &compensator);
    TEST_ASSERT_EQUAL_INT32(0, compensator.torque_q30);
}

static void test_counts_of_rejections_do_not_wrap(void)
{
    const dahl_compensator_plan_t plan = plan_of(&valid);
    dahl_compensator_t compensator = {.bad_ticks = UINT32_MAX, .rejected = UINT32_MAX};
    (void)dahl_compensator_move(&plan, &compensator, 1, 0);
    TEST_ASSERT_TRUE(compensator.bad_ticks == UINT32_MAX && compensator.rejected == UINT32_MAX);
}

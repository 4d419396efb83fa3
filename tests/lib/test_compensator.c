/* SPDX-License-Identifier: MIT */
/* dahl_compensator.h call by call: checks of the parameters, play, rejection, fades, limits, and any bits as a state. */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

#include "../random.h"
#include "dahl_compensator.h"

#define ONE_Q30 (1 << 30)

static const dahl_compensator_params_t valid = {
    .friction = {100.0f, 0.5f, 3.8349519e-4f},
    .law = DAHL_COMPENSATOR_MEASURED,
    .Fc_low = 0.5f,
    .length_long = 0.005f,
    .gain = 1.0f,
    .limit = 0.5f,
    .slew = 1e6f,
    .period = 1e-3f,
    .noise = 1,
    .play = 2,
    .jump = 100,
};

static dahl_compensator_plan_t plan_of(const dahl_compensator_params_t *params)
{
    dahl_compensator_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_compensator_prepare(&plan, params));
    return plan;
}

static int32_t random_i32(uint64_t *seed)
{
    return (int32_t)random_u32(seed) >> (random_u32(seed) & 31u);
}

/* --- prepare ---------------------------------------------------------------------------------------------------------- */

typedef struct {
    size_t member; /* of a float */
    float value;
    dahl_compensator_err_t code;
} float_case_t;

#define AT(member) offsetof(dahl_compensator_params_t, member)

static void test_wrong_floats_are_refused_with_a_code(void)
{
    static const float_case_t cases[] = {
        {AT(friction.sigma0), 0.0f, DAHL_COMPENSATOR_PARAM},
        {AT(friction.theta_per_count), 0.0f, DAHL_COMPENSATOR_PARAM},
        {AT(friction.Fc), 0x1p-70f, DAHL_COMPENSATOR_RANGE},
        {AT(Fc_low), 0.0f, DAHL_COMPENSATOR_PARAM},
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
        {AT(pull), NAN, DAHL_COMPENSATOR_PARAM},
        {AT(fade_speed), 0.03f, DAHL_COMPENSATOR_RANGE}, /* jump is 1278 times this speed */
        {AT(fade_speed), 0.04f, DAHL_COMPENSATOR_OK},
        {AT(Fc_low), 0.49999997f, DAHL_COMPENSATOR_GAIN},
        {AT(friction.Fc), 0.50000006f, DAHL_COMPENSATOR_GAIN},
        {AT(length_long), 0.005000001f, DAHL_COMPENSATOR_SLOPE},
        {AT(friction.sigma0), 100.00002f, DAHL_COMPENSATOR_SLOPE},
        {AT(gain), 0.0f, DAHL_COMPENSATOR_OK},
        {AT(length_long), 0.004999999f, DAHL_COMPENSATOR_OK},
    };
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        dahl_compensator_params_t params = valid;
        dahl_compensator_plan_t plan = {.gain_q16 = 77}, before = plan;
        memcpy((char *)&params + cases[k].member, &cases[k].value, sizeof(float));
        TEST_ASSERT_EQUAL_INT_MESSAGE(cases[k].code, dahl_compensator_prepare(&plan, &params), "case");
        TEST_ASSERT_TRUE((cases[k].code == DAHL_COMPENSATOR_OK) == (memcmp(&plan, &before, sizeof plan) != 0));
    }
}

static void test_bounds_in_float_make_an_element_that_passes(void)
{
    uint64_t seed = 6;
    for (int k = 0; k < 2000; k++) {
        dahl_compensator_params_t params = valid;
        dahl_compensator_plan_t plan;
        params.Fc_low = params.friction.Fc = params.limit = 0.1f + (float)random_u32(&seed) * 0x1p-32f;
        params.length_long = 0.001f + (float)random_u32(&seed) * 0x1p-36f;
        params.friction.sigma0 = params.Fc_low / params.length_long;
        TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_compensator_prepare(&plan, &params));
        params.length_long *= 1.000001f;
        TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_SLOPE, dahl_compensator_prepare(&plan, &params));
    }
}

static void test_wrong_counts_are_refused_with_a_code(void)
{
    static const struct {
        uint32_t noise, play, jump;
        dahl_compensator_err_t code;
    } cases[] = {{1, 1, 9, DAHL_COMPENSATOR_PLAY}, {0, 0, 9, DAHL_COMPENSATOR_PLAY},  {5, 9, 9, DAHL_COMPENSATOR_PLAY},
                 {0, 1, 9, DAHL_COMPENSATOR_OK},   {5, 10, 9, DAHL_COMPENSATOR_OK},   {1, 2, 0, DAHL_COMPENSATOR_PARAM},
                 {0, 1u << 25, 9, DAHL_COMPENSATOR_RANGE}, {UINT32_MAX, 4, 9, DAHL_COMPENSATOR_RANGE},
                 {0, 1, UINT32_MAX, DAHL_COMPENSATOR_RANGE}};
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        dahl_compensator_params_t params = valid;
        dahl_compensator_plan_t plan;
        params.noise = cases[k].noise;
        params.play = cases[k].play;
        params.jump = cases[k].jump;
        TEST_ASSERT_EQUAL_INT(cases[k].code, dahl_compensator_prepare(&plan, &params));
    }
}

/* Of 0.01 to 10^7 counts of a tick at fade_speed. The header promises a little less than 1024 times these counts. */
static void test_the_longest_jump_follows_the_fade_speed(void)
{
    uint64_t seed = 10;
    for (int k = 0; k < 2000; k++) {
        dahl_compensator_params_t params = valid;
        dahl_compensator_plan_t plan;
        const double counts = 0.01 * exp(random_u32(&seed) * 0x1p-32 * log(1e9));
        const double factor = DAHL_COMPENSATOR_JUMP_SPEEDS / (counts > DAHL_COMPENSATOR_FINE_COUNTS ? 2.0 : 1.0);
        params.fade_speed = (float)(counts * (double)params.friction.theta_per_count / 1e-3);
        params.jump = (uint32_t)fmin(DAHL_COMPENSATOR_JUMP_MAX - 1, fmax(1, floor(factor * counts * 0.999)));
        TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_compensator_prepare(&plan, &params));
        params.jump = (uint32_t)fmin(DAHL_COMPENSATOR_JUMP_MAX + 1, ceil(1100 * counts));
        TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_RANGE, dahl_compensator_prepare(&plan, &params));
    }
}

static void test_the_reference_law_needs_no_bounds_but_keeps_given_ones(void)
{
    dahl_compensator_params_t params = valid;
    dahl_compensator_plan_t plan;
    params.law = DAHL_COMPENSATOR_REFERENCE;
    params.Fc_low = params.length_long = 0.0f;
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_compensator_prepare(&plan, &params));
    params.Fc_low = 0.4f;
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_GAIN, dahl_compensator_prepare(&plan, &params));
    params = valid;
    params.law = (dahl_compensator_law_t)3;
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_PARAM, dahl_compensator_prepare(&plan, &params));
}

static void test_extreme_parameters_give_a_plan_at_its_limits(void)
{
    dahl_compensator_params_t params = valid;
    params.slew = params.limit = 0x1p-60f;
    params.rise = 0x1p40f;
    params.pull = 0x1p40f;
    dahl_compensator_plan_t plan = plan_of(&params);
    TEST_ASSERT_EQUAL_UINT32(1, plan.slew_q30);
    TEST_ASSERT_EQUAL_UINT32(1, plan.rise_q30);
    TEST_ASSERT_EQUAL_INT32(0, plan.limit_q30);
    TEST_ASSERT_EQUAL_UINT32(1, plan.pull_shift);
    params.slew = params.limit = 0x1p63f;
    params.pull = 0x1p-60f;
    params.period = 0x1p-20f;
    plan = plan_of(&params);
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, plan.slew_q30);
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, plan.limit_q30);
    TEST_ASSERT_EQUAL_UINT32(30, plan.pull_shift);
    TEST_ASSERT_EQUAL_UINT32(12, plan.speed_shift); /* longest mean: 2^12 ticks of a microsecond */
}

/* --- move ------------------------------------------------------------------------------------------------------------- */

static void test_the_play_follows_the_counts_within_its_width(void)
{
    uint64_t seed = 3;
    for (uint32_t play = 1; play < 40; play++) {
        dahl_compensator_params_t params = valid;
        dahl_compensator_t compensator = {0};
        int64_t counts = 0, followed = 0;
        params.noise = play / 2;
        params.play = play;
        const dahl_compensator_plan_t plan = plan_of(&params);
        for (int t = 0; t < 2000; t++) {
            int32_t dcounts = (int32_t)(random_u32(&seed) % 201) - 100;
            int32_t move = dahl_compensator_move(&plan, &compensator, dcounts, 1);
            counts += dcounts;
            followed += move;
            const int64_t position = counts - followed;
            TEST_ASSERT_TRUE(0 <= position && position <= play);
            TEST_ASSERT_TRUE((int64_t)move * dcounts >= 0);
            TEST_ASSERT_TRUE(move == 0 || position == (move > 0 ? play : 0)); /* it leaves at an end */
        }
    }
}

static void test_bad_readings_hold_then_fade(void)
{
    dahl_compensator_params_t params = valid;
    params.fall = 0.010f; /* 10 ticks */
    params.rise = 0.100f;
    const dahl_compensator_plan_t plan = plan_of(&params);
    dahl_compensator_t compensator = {0};
    for (int t = 1; t <= 100; t++) {
        TEST_ASSERT_EQUAL_INT32(t == 1 ? 8 : 10, dahl_compensator_move(&plan, &compensator, 10, 1));
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, t / 100.0, compensator.fade_q30 * 0x1p-30);
    }
    for (int t = 1; t <= 15; t++) { /* jumps, and readings that the caller rejects */
        const int32_t jump = t % 3 == 0 ? 101 : t % 3 == 1 ? INT32_MIN : 0;
        const double fade = t < 3 ? 1 : fmax(0, 1 - (t - 2) / 10.0);
        TEST_ASSERT_EQUAL_INT32(0, dahl_compensator_move(&plan, &compensator, jump, jump != 0));
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, fade, compensator.fade_q30 * 0x1p-30);
        TEST_ASSERT_EQUAL_UINT32((uint32_t)t, compensator.rejected);
    }
    TEST_ASSERT_EQUAL_INT32(-98, dahl_compensator_move(&plan, &compensator, -100, 1));
    TEST_ASSERT_EQUAL_UINT32(0, compensator.bad_ticks);
}

/* --- torque ----------------------------------------------------------------------------------------------------------- */

static double expected_torque(const dahl_compensator_params_t *params, double ratio, double fade, double speed)
{
    const double over = params->fade_speed > 0 ? fabs(speed) / params->fade_speed : 0;
    return ratio * params->gain * fade * fmax(0, fmin(1, 2 - over));
}

static void test_each_factor_scales_the_torque(void)
{
    uint64_t seed = 5;
    for (int k = 0; k < 20000; k++) {
        dahl_compensator_params_t params = valid;
        params.gain = (float)(random_u32(&seed) % 1001) / 1000.0f;
        params.limit = 0.1f + (float)(random_u32(&seed) % 1000) / 1000.0f;
        params.fade_speed = k % 2 == 0 ? 0.0f : 2.0f;
        const dahl_compensator_plan_t plan = plan_of(&params);
        const double speed = random_u32(&seed) % 10000 / 1000.0 - 5, fade = random_u32(&seed) * 0x1p-32;
        dahl_compensator_t compensator = {.fade_q30 = (uint32_t)(fade * ONE_Q30)};
        compensator.speed_q20 = k % 2 == 0 ? 0 : (int32_t)(speed / 2.0 * (1 << 20));
        const int32_t ratio = random_i32(&seed);
        const int32_t torque = dahl_compensator_torque(&plan, &compensator, ratio);
        const double exact = expected_torque(&params, ratio * 0x1p-30, fade, speed);
        const double limit = (double)params.limit / (double)params.friction.Fc;
        TEST_ASSERT_DOUBLE_WITHIN(4 * 0x1p-15, exact, compensator.wanted_q30 * 0x1p-30);
        TEST_ASSERT_DOUBLE_WITHIN(4 * 0x1p-15, fmax(-limit, fmin(limit, exact)), torque * 0x1p-30);
    }
}

static void test_full_gain_returns_the_ratio(void)
{
    uint64_t seed = 2;
    dahl_compensator_params_t params = valid;
    params.limit = 100.0f;
    const dahl_compensator_plan_t plan = plan_of(&params);
    for (int k = 0; k < 1000; k++) {
        dahl_compensator_t compensator = {.fade_q30 = ONE_Q30};
        const int32_t ratio = k == 0 ? ONE_Q30 : random_i32(&seed);
        TEST_ASSERT_EQUAL_INT32(ratio == INT32_MIN ? -INT32_MAX : ratio, dahl_compensator_torque(&plan, &compensator, ratio));
    }
}

static void test_the_mean_of_the_speed_follows_the_moves(void)
{
    dahl_compensator_params_t params = valid;
    dahl_compensator_t compensator = {0};
    params.fade_speed = 3.0f;
    const dahl_compensator_plan_t plan = plan_of(&params);
    for (int t = 1; t <= 300; t++) {
        const int32_t dcounts = t <= 100 ? 10 : t <= 200 ? -100 : 0;
        const double speed = dcounts * (double)params.friction.theta_per_count * 1e3;
        (void)dahl_compensator_move(&plan, &compensator, dcounts, 1);
        if (t % 100 == 0) {
            TEST_ASSERT_DOUBLE_WITHIN(0.01, speed / 3, compensator.speed_q20 * 0x1p-20);
        }
    }
}

/* The sum of rounded changes must not depend on the direction, also with the longest mean: 2^11 ticks of 4 us. */
static void test_opposite_motions_have_opposite_speeds(void)
{
    uint64_t seed = 1;
    dahl_compensator_params_t params = valid;
    params.period = 4e-6f;
    params.fade_speed = 4.0f;
    params.play = 8;
    params.jump = 40;
    const dahl_compensator_plan_t plan = plan_of(&params);
    dahl_compensator_t forward = {.fade_q30 = ONE_Q30}, backward = {.fade_q30 = ONE_Q30, .play_position = 8};
    TEST_ASSERT_EQUAL_UINT32(11, plan.speed_shift);
    for (int t = 0; t < 400000; t++) { /* to 6 rad/s and back to rest */
        const double speed = t < 300000 ? t * 2e-5 : 0;
        const int32_t dcounts = random_u32(&seed) * 0x1p-32 < speed * 4e-6 / (double)valid.friction.theta_per_count;
        TEST_ASSERT_EQUAL_INT32(dahl_compensator_move(&plan, &forward, dcounts, 1),
                                -dahl_compensator_move(&plan, &backward, -dcounts, 1));
        TEST_ASSERT_EQUAL_INT32(forward.speed_q20, -backward.speed_q20);
        const int32_t torque = dahl_compensator_torque(&plan, &forward, ONE_Q30);
        TEST_ASSERT_INT32_WITHIN(1, torque, -dahl_compensator_torque(&plan, &backward, -ONE_Q30));
    }
    TEST_ASSERT_INT32_WITHIN(1 << 11, 0, forward.speed_q20);
}

/* The torque after 200 ticks at a speed, for an encoder with this many bits, fade_speed 100 rad/s and 1 kHz. */
static int32_t torque_at_speed(int bits, float speed)
{
    dahl_compensator_params_t params = valid;
    dahl_compensator_t compensator = {0};
    params.friction.theta_per_count = ldexpf(6.2831853f, -bits);
    params.fade_speed = 100.0f;
    params.jump = (uint32_t)(0.3f / params.friction.theta_per_count);
    const dahl_compensator_plan_t plan = plan_of(&params);
    const int32_t dcounts = (int32_t)(speed * params.period / params.friction.theta_per_count);
    for (int t = 0; t < 200; t++) {
        (void)dahl_compensator_move(&plan, &compensator, dcounts, 1);
    }
    return dahl_compensator_torque(&plan, &compensator, ONE_Q30);
}

static void test_a_fine_encoder_does_not_fade_late(void)
{
    for (int bits = 14; bits <= 30; bits++) {
        TEST_ASSERT_EQUAL_INT32(0, torque_at_speed(bits, 210.0f));
        TEST_ASSERT_TRUE(bits > 22 || torque_at_speed(bits, 90.0f) == ONE_Q30);
    }
}

/* --- any bits --------------------------------------------------------------------------------------------------------- */

static void randomize(void *memory, size_t bytes, uint64_t *seed)
{
    for (size_t k = 0; k < bytes; k++) {
        ((unsigned char *)memory)[k] = (unsigned char)random_u32(seed);
    }
}

/* Of a bristle: at most 1 Fc of either sign. */
static int64_t random_state_w(uint64_t *seed)
{
    const uint64_t bits = (uint64_t)random_u32(seed) << 32 | random_u32(seed);
    return (int64_t)(bits >> 1) - (INT64_C(1) << 62);
}

static void test_any_state_keeps_the_limit(void)
{
    uint64_t seed = 9;
    dahl_adaptation_plan_t adaptation_plan;
    dahl_compensator_params_t params = valid;
    params.law = DAHL_COMPENSATOR_REFERENCE;
    params.limit = 0.3f;
    params.slew = 3.0f;
    const dahl_compensator_plan_t plan = plan_of(&params), zeros = {0};
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_adaptation_prepare(&adaptation_plan, &params, 0.002f));
    for (int k = 0; k < 20000; k++) {
        dahl_compensator_t compensator;
        dahl_adaptation_t adaptation;
        randomize(&compensator, sizeof compensator, &seed);
        randomize(&adaptation, sizeof adaptation, &seed);
        for (int t = 0; t < 4; t++) {
            (void)dahl_compensator_move(&plan, &compensator, random_i32(&seed), (int)(random_u32(&seed) % 8));
            TEST_ASSERT_TRUE(labs(dahl_compensator_torque(&plan, &compensator, random_i32(&seed))) <= plan.limit_q30);
            dahl_adaptation_step(&adaptation_plan, &adaptation, &compensator, random_i32(&seed));
            const int32_t ratio = random_i32(&seed), scaled = dahl_adaptation_apply(&adaptation, ratio);
            const double factor = 1 + fmax(-0.5, fmin(0.5, adaptation.Fc_change_q16 * 0x1p-16));
            TEST_ASSERT_DOUBLE_WITHIN(1e-6, fmax(-2, fmin(2, ratio * 0x1p-30 * factor)), scaled * 0x1p-30);
        }
        TEST_ASSERT_EQUAL_INT32(0, dahl_compensator_torque(&zeros, &compensator, random_i32(&seed)));
    }
}

/* Between all states, also beyond +-1 Fc. A step of the pull is 2^-30 Fc. */
static void test_a_pull_closes_its_part_of_the_gap(void)
{
    uint64_t seed = 4;
    dahl_compensator_params_t params = valid;
    params.law = DAHL_COMPENSATOR_REFERENCE;
    params.pull = 0.3f;
    const dahl_compensator_plan_t plan = plan_of(&params), without = plan_of(&valid);
    for (int k = 0; k < 1000; k++) {
        dahl_state_t state, measured;
        randomize(&state, sizeof state, &seed);
        randomize(&measured, sizeof measured, &seed);
        const int64_t before = state.w;
        dahl_compensator_pull(&without, &state, &measured);
        TEST_ASSERT_TRUE(before == state.w);
        dahl_compensator_pull(&plan, &state, &measured);
        const double gap = (double)measured.w - (double)before, moved = (double)state.w - (double)before;
        TEST_ASSERT_DOUBLE_WITHIN(0x1p33, gap / 512, moved); /* 0.31 Hz at 1 kHz */
    }
}

/* The frequency at which y += p (x - y) halves the power: cos w = 1 - p^2/(2 - 2 p). */
static double corner_hertz(const dahl_compensator_plan_t *plan, double period)
{
    const double part = 1.0 / (double)(1 << plan->pull_shift);
    return acos(1 - part * part / (2 - 2 * part)) / (6.283185307179586 * period);
}

static void test_the_corner_of_a_pull_is_near_the_wanted_one(void)
{
    dahl_compensator_params_t params = valid;
    params.law = DAHL_COMPENSATOR_REFERENCE;
    params.period = 0x1p-10f;
    for (double times_period = 1e-4; times_period < 0.17; times_period *= 1.01) {
        params.pull = (float)(times_period / (double)params.period);
        const dahl_compensator_plan_t plan = plan_of(&params);
        const double ratio = corner_hertz(&plan, (double)params.period) / (double)params.pull;
        const double factor = times_period < 0.014 ? 1.5 : 2.1;
        TEST_ASSERT_TRUE(1 / factor < ratio && ratio < factor);
    }
}

/* A gap below 2^(pull_shift - 30) Fc stays. */
static void test_a_pull_reaches_the_measured_state(void)
{
    uint64_t seed = 8;
    dahl_compensator_params_t params = valid;
    params.law = DAHL_COMPENSATOR_REFERENCE;
    params.pull = 10.0f;
    const dahl_compensator_plan_t plan = plan_of(&params);
    TEST_ASSERT_EQUAL_UINT32(4, plan.pull_shift);
    for (int k = 0; k < 1000; k++) {
        dahl_state_t state = {random_state_w(&seed)}, measured = {random_state_w(&seed)};
        for (int t = 0; t < 500; t++) {
            const int64_t before = state.w;
            dahl_compensator_pull(&plan, &state, &measured);
            TEST_ASSERT_TRUE(llabs(state.w - measured.w) <= llabs(before - measured.w) + (INT64_C(1) << 32));
        }
        TEST_ASSERT_TRUE(llabs(state.w - measured.w) <= INT64_C(1) << (32 + 4));
    }
}

/* --- adaptation ------------------------------------------------------------------------------------------------------- */

static void test_the_adaptation_refuses_the_measured_law_and_bad_values(void)
{
    dahl_adaptation_plan_t plan;
    dahl_compensator_params_t params = valid;
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_WRONG_LAW, dahl_adaptation_prepare(&plan, &params, 0.002f));
    params.law = DAHL_COMPENSATOR_REFERENCE;
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_adaptation_prepare(&plan, &params, 0.002f));
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_PARAM, dahl_adaptation_prepare(&plan, &params, 0.0f));
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_PARAM, dahl_adaptation_prepare(&plan, &params, NAN));
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_RANGE, dahl_adaptation_prepare(&plan, &params, 0x1p-70f));
    params.period = 1e-9f;
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_adaptation_prepare(&plan, &params, 0x1p63f));
    TEST_ASSERT_EQUAL_UINT32(15, plan.bin_shift);
    TEST_ASSERT_EQUAL_INT32(0, plan.gap_q20);
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_adaptation_prepare(&plan, &params, 0x1p-63f));
    TEST_ASSERT_EQUAL_INT32(1 << 30, plan.gap_q20);
    params.period = 0.021f;
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_RANGE, dahl_adaptation_prepare(&plan, &params, 0.002f));
}

/* Slides of 0.45 s in both directions. The true Fc is 1.2 times that of the element. */
typedef struct {
    const char *name;
    double from, to;   /* rad/s, speed at the start and at the end of a slide */
    double ratio;      /* torque of the element at a slide, in Fc */
    double load;       /* N m, added to the motor */
    int bad_every;     /* ticks */
    enum { IN_TURN, FORWARD, APART } order;
    double expected; /* change of Fc after 60 s */
} slides_t;

enum { SLIDE = 450 };
#define INERTIA 0.02
#define ADAPTED_FC 0.6

/* Apart: one direction in each window of 30 s. */
static int direction_at(const slides_t *slides, int t)
{
    if (slides->order == APART) {
        return t < 20000 ? 1 : t < 35000 ? 0 : -1;
    }
    return slides->order == FORWARD || t / SLIDE % 2 == 0 ? 1 : -1;
}

static double change_after(const slides_t *slides, int ticks)
{
    dahl_compensator_params_t params = valid;
    dahl_adaptation_plan_t plan;
    dahl_adaptation_t adaptation = {0};
    dahl_compensator_t compensator = {0};
    double angle = 0;
    params.law = DAHL_COMPENSATOR_REFERENCE;
    TEST_ASSERT_EQUAL_INT(DAHL_COMPENSATOR_OK, dahl_adaptation_prepare(&plan, &params, (float)INERTIA));
    for (int t = 0; t < ticks; t++) {
        const int direction = direction_at(slides, t), sign = direction < 0 ? -1 : 1;
        const double acceleration = (slides->to - slides->from) / (double)SLIDE * 1e3;
        const double before = floor(angle);
        angle += sign * (slides->from + acceleration * (t % SLIDE) * 1e-3) * 1e-3 / (double)valid.friction.theta_per_count;
        compensator.move = (int32_t)(floor(angle) - before);
        compensator.bad_ticks = slides->bad_every > 0 && t % slides->bad_every == 0;
        const double motor = (sign * (ADAPTED_FC + INERTIA * acceleration) + slides->load) / (double)valid.friction.Fc;
        (void)dahl_adaptation_apply(&adaptation, (int32_t)(direction * slides->ratio * ONE_Q30));
        dahl_adaptation_step(&plan, &adaptation, &compensator, (int32_t)lround(motor * 0x1p24));
    }
    return adaptation.Fc_change_q16 * 0x1p-16;
}

static void test_only_steady_slides_in_both_directions_count(void)
{
    static const slides_t cases[] = {
        {"steady", 0.5, 0.5, 1, 0, 0, IN_TURN, 0.2},
        {"accelerated", 0.3, 0.8, 1, 0, 0, IN_TURN, 0.2},
        {"under a load", 0.5, 0.5, 1, 0.375, 0, IN_TURN, 0.2},
        {"presliding", 0.5, 0.5, 0.96, 0, 0, IN_TURN, 0},
        {"against the torque", 0.5, 0.5, -1, 0, 0, IN_TURN, 0},
        {"too slow", 0.02, 0.02, 1, 0, 0, IN_TURN, 0},
        {"too fast", 1.3, 1.3, 1, 0, 0, IN_TURN, 0},
        {"accelerated too much", -1.2, 2, 1, 0, 0, IN_TURN, 0},
        {"bad encoder", 0.5, 0.5, 1, 0, 50, IN_TURN, 0},
        {"above 4 Fc", 0.5, 0.5, 1, 2.7, 0, IN_TURN, 0},
        {"one direction", 0.5, 0.5, 1, 0, 0, FORWARD, 0},
        {"both directions, but not within 30 s", 0.5, 0.5, 1, 0, 0, APART, 0},
    };
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        const double change = change_after(&cases[k], 60000);
        TEST_ASSERT_TRUE_MESSAGE(fabs(change - cases[k].expected) <= 0.01, cases[k].name);
    }
}

static void test_the_first_pair_of_bins_closes_a_quarter_of_the_gap(void)
{
    static const slides_t steady = {"steady", 0.5, 0.5, 1, 0, 0, IN_TURN, 0.2};
    TEST_ASSERT_DOUBLE_WITHIN(0.002, 0.05, change_after(&steady, 3000));
}

static void test_a_rejected_adaptation_changes_no_torque(void)
{
    static const dahl_adaptation_plan_t zeros = {0};
    const dahl_compensator_t compensator = {.move = 1};
    dahl_adaptation_t adaptation = {0};
    for (int t = 0; t < 1000; t++) {
        TEST_ASSERT_EQUAL_INT32(ONE_Q30, dahl_adaptation_apply(&adaptation, ONE_Q30));
        dahl_adaptation_step(&zeros, &adaptation, &compensator, 1 << 25);
    }
}

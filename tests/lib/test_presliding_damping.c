/* SPDX-License-Identifier: MIT */
/* Friction that a motor renders on a free knob, with and without presliding damping. The knob has no friction of its own. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "../random.h"
#include "dahl_parts.h"

#define TWO_PI 6.283185307179586
#define SUBSTEPS 20

typedef struct {
    double inertia, Fc, sigma0, zeta; /* zeta 0: no damping */
    double period, speed;             /* s, rad/s at the start */
    int bits, noise, delay;           /* counts, ticks */
} knob_t;

static double uniform(uint64_t *random, double least, double most)
{
    return least + (most - least) * random_u32(random) * 0x1p-32;
}

static float sigma1_of(const knob_t *knob)
{
    return (float)(2 * (knob->zeta > 0 ? knob->zeta : 1) * sqrt(knob->inertia * knob->sigma0));
}

/* Return the width of the motion in the last quarter, in rad. */
static double rendered_width(const knob_t *knob, uint64_t *random)
{
    const double theta_per_count = TWO_PI / (1 << knob->bits), dt = knob->period / SUBSTEPS;
    const dahl_params_t params = {(float)knob->sigma0, (float)knob->Fc, (float)theta_per_count};
    dahl_plan_t plan;
    dahl_state_t state = {0};
    dahl_damping_plan_t damping_plan;
    dahl_damping_t damping = {0};
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_prepare(&plan, &params));
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_damping_prepare(&damping_plan, &params, sigma1_of(knob), (float)knob->period));
    double theta = uniform(random, -1, 1), speed = knob->speed, commands[4] = {0}, low = INFINITY, high = -INFINITY;
    int64_t counts = (int64_t)floor(theta / theta_per_count);
    const double seconds = 100 * sqrt(knob->inertia / knob->sigma0) + 3 * knob->inertia * knob->speed / knob->Fc;
    const int ticks = 400 + (int)(seconds / knob->period);
    for (int k = 0; k < ticks; k++) {
        const int64_t before = counts;
        counts = (int64_t)floor(theta / theta_per_count + knob->noise * uniform(random, -1, 1));
        const int32_t w = dahl_step_counts_q30(&plan, &state, (int32_t)(counts - before));
        const int32_t damped = dahl_damping_apply(&damping_plan, &damping, w);
        memmove(commands + 1, commands, 3 * sizeof commands[0]);
        commands[0] = -(knob->zeta > 0 ? damped : w) * 0x1p-30 * knob->Fc;
        for (int n = 0; n < SUBSTEPS; n++) {
            speed += commands[knob->delay] / knob->inertia * dt;
            theta += speed * dt;
        }
        low = k > ticks * 3 / 4 ? fmin(low, theta) : low;
        high = k > ticks * 3 / 4 ? fmax(high, theta) : high;
    }
    return high - low;
}

static void test_a_knob_rests_with_damping_and_buzzes_without(void)
{
    uint64_t random = 1;
    for (int k = 0; k < 40; k++) {
        knob_t knob = {.inertia = 0.02, .Fc = 1, .sigma0 = 500, .zeta = 0.3, .period = 1e-3, .bits = 14, .delay = 1};
        knob.speed = exp(uniform(&random, log(0.05), log(20)));
        TEST_ASSERT_TRUE(rendered_width(&knob, &random) < 0.5e-3);
        knob.zeta = 0;
        TEST_ASSERT_TRUE(rendered_width(&knob, &random) > 2e-3);
    }
}

/* Return a knob at random, inside the rules of the header. */
static knob_t random_knob(uint64_t *random, int noise)
{
    knob_t knob = {.zeta = uniform(random, 0.2, 0.3), .noise = noise};
    const double length = exp(uniform(random, log(1e-3), log(2e-2))), counts = noise > 0 ? 20 : 5;
    knob.bits = (int)ceil(log2(TWO_PI * counts / length)) + (int)(random_u32(random) % 4);
    knob.delay = (int)(random_u32(random) % 3);
    knob.period = exp(uniform(random, log(1e-4), log(2e-3)));
    knob.Fc = exp(uniform(random, log(0.01), log(5)));
    knob.sigma0 = knob.Fc / length;
    const double late = (knob.delay + 1) * knob.period, angle = uniform(random, 0.05, 0.4);
    knob.inertia = knob.sigma0 * late * late / angle / angle;
    knob.speed = length * sqrt(knob.sigma0 / knob.inertia) * exp(uniform(random, log(0.3), log(30)));
    return knob;
}

/* Without damping, many of these knobs buzz. */
static void test_the_rules_of_the_header(void)
{
    uint64_t random = 2;
    for (int noise = 0; noise < 2; noise++) {
        double worst = 0;
        int buzzing = 0;
        for (int k = 0; k < 1000; k++) {
            knob_t knob = random_knob(&random, noise);
            worst = fmax(worst, rendered_width(&knob, &random) / TWO_PI * (1 << knob.bits));
            knob.zeta = 0;
            buzzing += rendered_width(&knob, &random) > 0.5 * knob.Fc / knob.sigma0;
        }
        TEST_ASSERT_TRUE(worst < (noise > 0 ? 10 : 2));
        TEST_ASSERT_TRUE(buzzing > 300);
    }
}

static void test_prepare_refuses_and_scales(void)
{
    const dahl_params_t params = {500.0f, 1.0f, 3.8e-4f}, wrong = {500.0f, NAN, 3.8e-4f};
    const struct {
        float sigma1, period;
        int code;
    } cases[] = {
        {0.0f, 1e-3f, DAHL_ERR_PARAM},     {NAN, 1e-3f, DAHL_ERR_PARAM},    {1.0f, INFINITY, DAHL_ERR_PARAM},
        {-1.0f, 1e-3f, DAHL_ERR_PARAM},    {1.0f, 0.0f, DAHL_ERR_PARAM},    {1e-30f, 1e-3f, DAHL_ERR_RANGE},
        {16400.0f, 1e-3f, DAHL_ERR_RANGE}, {1e-6f, 1.0f, DAHL_ERR_RANGE},   {1e30f, 1e-3f, DAHL_ERR_RANGE},
        {1e15f, 1e-6f, DAHL_ERR_RANGE},    {1.9f, 1e-3f, DAHL_OK},
    };
    dahl_damping_plan_t plan = {-1};
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, dahl_damping_prepare(&plan, &wrong, 1.9f, 1e-3f));
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        TEST_ASSERT_EQUAL_INT(-1, plan.gain_q16);
        TEST_ASSERT_EQUAL_INT(cases[k].code, dahl_damping_prepare(&plan, &params, cases[k].sigma1, cases[k].period));
    }
    uint64_t random = 4;
    dahl_damping_t damping = {0};
    for (int k = 0; k < 100000; k++) {
        const int32_t now = (int32_t)random_u32(&random), before = (int32_t)random_u32(&random) >> k % 31;
        damping.ratio_q30 = before;
        plan.gain_q16 = (int32_t)(random_u32(&random) >> (1 + k % 20));
        const double exact = now + plan.gain_q16 * 0x1p-16 * ((double)now - before);
        const double wanted = fmax(-INT32_MAX, fmin(INT32_MAX, exact));
        TEST_ASSERT_DOUBLE_WITHIN(plan.gain_q16 * 0x1p-15 + 2, wanted, dahl_damping_apply(&plan, &damping, now));
        TEST_ASSERT_EQUAL_INT32(now, damping.ratio_q30);
    }
}

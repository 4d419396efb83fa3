/* SPDX-License-Identifier: MIT */
/* Parameters over the bus: read-back, parameters held for a joint change, gain, limit and ramp. tests/python/can/test_codec.py
 * compares the range of each setting with dahl.dbc. */
#include <unity.h>

#include "node_talk.h"
#include "random.h"

void setUp(void)
{
    talk_begin();
}

void tearDown(void)
{
}

static dahl_plan_t plan_of(float sigma0, float Fc)
{
    const dahl_params_t p = {sigma0, Fc, params.theta_per_count};
    dahl_plan_t plan;
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_prepare(&plan, &p));
    return plan;
}

/* Written values of 24 bits are returned exactly. Others are rounded, a half up, and limited to 32 bits. */
static void test_parameters_are_read_back_in_raw_units(void)
{
    static const struct {
        float sigma0;
        uint32_t raw;
    } cases[] = {{3.5f * 0x1p-10f, 4}, {0x1.7ffffep-11f, 1}, {0x1.fffffep-12f, 0}, {2.25f * 0x1p-10f, 2}, {1e10f, UINT32_MAX}};
    for (uint32_t value = (1u << 24) - 9; value <= 1u << 24; value++) {
        TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_SIGMA0, value) && param_now(DAHL_FRAMES_PARAM_SIGMA0) == value);
    }
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_SIGMA0, (1u << 23) + 1) && param_now(DAHL_FRAMES_PARAM_SIGMA0) == (1u << 23) + 1);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const dahl_params_t p = {.sigma0 = cases[i].sigma0, .Fc = cases[i].sigma0, .theta_per_count = 1.0f};
        TEST_ASSERT_EQUAL(DAHL_OK, dahl_node_init(&node, &p, NUMBER));
        TEST_ASSERT_EQUAL_HEX32(cases[i].raw, param_now(DAHL_FRAMES_PARAM_SIGMA0));
        TEST_ASSERT_EQUAL_HEX32(UINT32_MAX, param_now(DAHL_FRAMES_PARAM_THETA));
    }
    TEST_ASSERT_EQUAL(2, node.counts.params);
}

static void test_a_time_in_us_reads_as_the_nearest_ms(void)
{
    static const uint32_t us[][2] = {{0, 0}, {499, 0}, {500, 1}, {30400, 30}, {30600, 31}, {UINT32_MAX, 4294967}};
    for (size_t i = 0; i < sizeof us / sizeof us[0]; i++) {
        node.timeout_us = us[i][0];
        TEST_ASSERT_EQUAL(us[i][1], param_now(DAHL_FRAMES_PARAM_TIMEOUT));
    }
}

/* A held value acts with the next write. So sigma0 and Fc may change together, also if only both together are in range. */
static void test_held_parameters_change_together(void)
{
    const dahl_plan_t plan = plan_of(params.sigma0, params.Fc), both = plan_of(params.sigma0 * 4, params.Fc * 2);
    dahl_state_t reference = {0};
    TEST_ASSERT_TRUE(feed(0, 0) && feed(1, 300));
    (void)dahl_step_counts_q30(&plan, &reference, 300);
    TEST_ASSERT_EQUAL(1u << 19, ask(DAHL_FRAMES_PARAM_FC, DAHL_FRAMES_PARAM_HOLD, 1u << 20).value); /* the old value */
    TEST_ASSERT_TRUE(feed(2, 250));
    TEST_ASSERT_EQUAL(dahl_step_counts_q30(&plan, &reference, -50), answer.torque_q30);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_SIGMA0, 200u << 10));
    dahl_change_plan(&plan, &both, &reference);
    TEST_ASSERT_TRUE(feed(3, 270));
    TEST_ASSERT_EQUAL(dahl_step_counts_q30(&both, &reference, 20), answer.torque_q30);
    TEST_ASSERT_FALSE(set_param(DAHL_FRAMES_PARAM_THETA, 0)); /* which a plan may have */
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_THETA, UINT32_MAX) && set_param(DAHL_FRAMES_PARAM_SIGMA0, UINT32_MAX));
    TEST_ASSERT_FALSE(set_param(DAHL_FRAMES_PARAM_FC, 1));
    TEST_ASSERT_EQUAL(DAHL_FRAMES_PARAM_DONE, ask(DAHL_FRAMES_PARAM_SIGMA0, DAHL_FRAMES_PARAM_HOLD, 1).result);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_FC, 1));
    TEST_ASSERT_EQUAL(1, param_now(DAHL_FRAMES_PARAM_SIGMA0));
    (void)ask(DAHL_FRAMES_PARAM_SIGMA0, DAHL_FRAMES_PARAM_HOLD, 2);
    (void)reset(DAHL_FRAMES_RESET_RESTART); /* drops what is held */
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_FC, 2));
    TEST_ASSERT_EQUAL(1, param_now(DAHL_FRAMES_PARAM_SIGMA0));
}

/* Also if the firmware sets values beyond the range of a client. */
static void test_any_gain_and_limit_keep_the_answer_in_range(void)
{
    static const uint32_t values[] = {DAHL_NODE_ONE / 2, DAHL_NODE_ONE, DAHL_NODE_ONE + 1, 2 * DAHL_NODE_ONE, UINT32_MAX};
    enum { VALUES = sizeof values / sizeof values[0] };
    for (size_t i = 0; i < VALUES * VALUES; i++) {
        const uint32_t gain = values[i % VALUES], limit = values[i / VALUES];
        const int32_t most = gain < DAHL_NODE_ONE || limit < DAHL_NODE_ONE ? 1 << 29 : 1 << 30;
        talk_begin();
        node.gain = gain;
        node.limit = limit;
        TEST_ASSERT_TRUE(feed(0, 0) && answer.torque_q30 == 0);
        TEST_ASSERT_TRUE(feed(1, 100000000) && answer.torque_q30 == most);
        TEST_ASSERT_TRUE(feed(2, -100000000) && answer.torque_q30 == -most);
    }
}

/* --- the ramp ------------------------------------------------------------------------------------------------------ */

/* The expected gain: it changes by 1/ramp per us between two answers, of which at most 65,535 us count. */
typedef struct {
    double gain, target, ramp_us;
    uint32_t counter, changes; /* each change may add a rounding step */
    int32_t count;
} ramp_t;

static void pass(ramp_t *r, uint32_t us)
{
    const double way = r->ramp_us > 0 ? DAHL_NODE_ONE * (us < 65535 ? us : 65535) / r->ramp_us : DAHL_NODE_ONE;
    const double missing = r->target - r->gain;
    r->gain += missing > way ? way : missing < -way ? -way : missing;
}

/* The bristle is at its end, so the answer is the gain. */
static void check_ramp(ramp_t *r, uint32_t us)
{
    now_us += us - 1000; /* feed() lets 1 ms pass */
    r->count = (int32_t)((uint32_t)r->count + 1000000u); /* wraps */
    TEST_ASSERT_TRUE(feed(r->counter++, r->count));
    pass(r, us);
    TEST_ASSERT_INT_WITHIN(1 + r->changes, (int32_t)r->gain, answer.torque_q30 >> 14);
}

static void start_ramp(ramp_t *r)
{
    (void)reset(DAHL_FRAMES_RESET_RESTART);
    r->gain = r->ramp_us > 0 ? 0 : r->target;
    r->changes = 0;
    now_us += 50000; /* the first frame does not advance the ramp */
    TEST_ASSERT_TRUE(feed(r->counter++, r->count) && answer.torque_q30 == 0);
}

static void change_ramp(ramp_t *r, uint64_t *seed)
{
    static const uint32_t ramps_ms[] = {0, 1, 10, 100, 1000, 60000};
    const uint32_t ms = ramps_ms[random_u32(seed) % 6], gain = random_u32(seed) % 3 * (DAHL_NODE_ONE / 2);
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_RAMP, ms) && set_param(DAHL_FRAMES_PARAM_GAIN, gain));
    r->ramp_us = 1000.0 * ms;
    r->target = gain;
    r->changes++;
}

/* From each ramp to each other one, half way: the gain goes on from its value, at the new rate. */
static void test_a_gain_goes_on_at_the_new_rate_if_its_ramp_changes(void)
{
    static const uint32_t ramps_ms[] = {0, 1, 20, 300, 1000, 60000};
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_TIMEOUT, 60000));
    for (uint32_t pair = 0; pair < 36; pair++) {
        const uint32_t from_ms = ramps_ms[pair / 6], to_ms = ramps_ms[pair % 6];
        ramp_t r = {.target = DAHL_NODE_ONE, .ramp_us = 1000.0 * from_ms};
        TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_RAMP, from_ms));
        start_ramp(&r);
        for (uint32_t us = 0; us < 500 * from_ms && us < 10000000; us += 777) {
            check_ramp(&r, 777);
        }
        TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_RAMP, to_ms));
        r.ramp_us = 1000.0 * to_ms;
        r.changes = 1;
        for (int t = 0; t < 200; t++) {
            check_ramp(&r, 100 + 900 * (pair % 2));
        }
    }
}

/* Random ramps and gains, frames 0.1 to 70 ms apart. After a restart a ramp begins at 0. */
static void test_the_gain_ramps_by_time_at_any_frame_rate(void)
{
    uint64_t seed = 3;
    ramp_t r = {0};
    TEST_ASSERT_TRUE(set_param(DAHL_FRAMES_PARAM_TIMEOUT, 60000));
    for (int run = 0; run < 400; run++) {
        const uint32_t most = run % 2 ? 70000 : 1500;
        change_ramp(&r, &seed);
        start_ramp(&r);
        for (int t = 0; t < 300; t++) {
            if (random_u32(&seed) % 64 == 0) {
                change_ramp(&r, &seed);
            }
            check_ramp(&r, 100 + random_u32(&seed) % most);
        }
        check_ramp(&r, 50000000);
    }
}

/* SPDX-License-Identifier: MIT */
/* Remarks on units: each limit from both sides, and parameters without a remark. The machines are in
 * tests/python/binding/test_plausible.py. */
#include <math.h>
#include <stdint.h>

#include "dahl_compensator.h"
#include "unity.h"

#define TURN 6.2831853f

static void expect(dahl_plausible_t wanted, float sigma0, float Fc, float theta)
{
    const dahl_params_t params = {sigma0, Fc, theta};
    TEST_ASSERT_EQUAL_INT(wanted, dahl_params_plausible(&params));
}

static void test_parameters_in_rad_have_no_remark(void)
{
    for (uint32_t counts = 4; counts != 0 && counts <= UINT32_C(1) << 26; counts *= 2) {
        expect(DAHL_PLAUSIBLE, 2.0f, 1.0f, TURN / (float)counts);
    }
    expect(DAHL_PLAUSIBLE, 2.0f, 1.0f, 0.0f);
    expect(DAHL_PLAUSIBLE, 2.0f, 1.0f, -0.0f);
}

static void test_parameters_that_are_rejected_have_no_remark(void)
{
    expect(DAHL_PLAUSIBLE, 0.0f, 1.0f, 1.0f);
    expect(DAHL_PLAUSIBLE, 2.0f, NAN, 4096.0f);
    expect(DAHL_PLAUSIBLE, 2.0f, 1.0f, INFINITY);
}

static void test_the_travel_of_a_count_may_be_out_of_range(void)
{
    expect(DAHL_COUNTS_PER_TURN, 100.0f, 0.5f, 65536.0f);
}

static void test_counts_per_turn(void)
{
    expect(DAHL_COUNTS_PER_TURN, 2.0f, 1.0f, 1.6000001f);
    expect(DAHL_PLAUSIBLE, 2.0f, 1.0f, 1.5999f);
}

static void test_degrees(void)
{
    expect(DAHL_DEGREES_PER_COUNT, 2.0f, 1.0f, 360.0f / 46080.0f);
    expect(DAHL_PLAUSIBLE, 2.0f, 1.0f, 360.0f / 46100.0f);
    expect(DAHL_PLAUSIBLE, 2.0f, 1.0f, 360.0f / 50000.0f);
    for (uint32_t counts = 256; counts <= UINT32_C(1) << 26; counts *= 2) {
        expect(DAHL_DEGREES_PER_COUNT, 2.0f, 1.0f, 360.0f / (float)counts);
    }
}

static void test_the_presliding_length(void)
{
    expect(DAHL_SHORT_PRESLIDING, 16.0f, 0.77f, 0.77f);
    expect(DAHL_PLAUSIBLE, 15.999f, 0.77f, 0.77f);
    expect(DAHL_LONG_PRESLIDING, 0.0078125f, 1.0f, 0.0f);
    expect(DAHL_LONG_PRESLIDING, 1.5f, 192.0f, 1e-3f);
    expect(DAHL_PLAUSIBLE, 0.0078126f, 1.0f, 0.0f);
}

static void expect_of(dahl_compensator_plausible_t wanted, float period, float rise, float fall, float fade_speed, uint32_t jump)
{
    const dahl_compensator_params_t params = {
        .friction = {100.0f, 0.5f, TURN / 16384}, .law = DAHL_COMPENSATOR_REFERENCE, .gain = 0.9f, .limit = 1.0f,
        .slew = 50.0f, .period = period, .rise = rise, .fall = fall, .fade_speed = fade_speed, .play = 1, .jump = jump};
    TEST_ASSERT_EQUAL_INT(wanted, dahl_compensator_params_plausible(&params));
}

static void test_the_period_of_a_compensator(void)
{
    expect_of(DAHL_COMPENSATOR_PLAUSIBLE, 1e-3f, 0.5f, 0.02f, 5.0f, 200);
    expect_of(DAHL_COMPENSATOR_LONG_PERIOD, 0.021f, 0.5f, 0.02f, 0.0f, 200);
    expect_of(DAHL_COMPENSATOR_PLAUSIBLE, 0.021f, 0.5f, 0.0f, 0.0f, 200);
    expect_of(DAHL_COMPENSATOR_LONG_PERIOD, 0.021f, 0.02f, 0.0f, 0.0f, 200);
    expect_of(DAHL_COMPENSATOR_PLAUSIBLE, 0.04f, 0.0f, 0.0f, 0.0f, 200);
    expect_of(DAHL_COMPENSATOR_LONG_PERIOD, 0.05f, 0.0f, 0.0f, 0.0f, 200);
    expect_of(DAHL_COMPENSATOR_PLAUSIBLE, -1.0f, 0.0f, 0.0f, 0.0f, 200); /* rejected */
}

static void test_the_fade_speed_of_a_compensator(void)
{
    expect_of(DAHL_COMPENSATOR_FAST_FADE, 1e-3f, 0.5f, 0.02f, 5.0f * 57.3f, 200);
    expect_of(DAHL_COMPENSATOR_PLAUSIBLE, 1e-3f, 0.5f, 0.02f, 5.0f * 57.3f, 750);
}

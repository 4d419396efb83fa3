/* SPDX-License-Identifier: MIT */
/* Floats on each core: one axis commissions itself, and its results are within the same bounds everywhere. */
#include <stdio.h>
#include <unity.h>

#include "plain_axis.h"

#define TICKS_MAX 30000
/* s from the acting torque to the reading: the delay of a tick, and half a tick of the held torque */
#define DELAY PLAIN_PERIOD

static void commission(dahl_commission_t *state)
{
    plain_axis_t axis = {0};
    dahl_commission_command_t command = {0};
    int32_t moved = 0;
    TEST_ASSERT_EQUAL(DAHL_COMMISSION_OK, dahl_commission_start(state, &plain_config));
    for (int tick = 0; tick < TICKS_MAX && state->command.stage < DAHL_COMMISSION_DONE; tick++) {
        dahl_commission_tick(state, moved, axis.command, &command);
        TEST_ASSERT_TRUE(command.torque <= command.torque_limit && command.torque >= -command.torque_limit);
        moved = plain_axis_tick(&axis, &command);
    }
}

static void assert_has(const dahl_commission_range_t *range, float value, float share)
{
    TEST_ASSERT_TRUE(range->least <= value && value <= range->most);
    TEST_ASSERT_FLOAT_WITHIN(share * value, value, range->best);
}

static void test_the_result_of_floats_is_the_same_on_each_core(void)
{
    static dahl_commission_t state;
    commission(&state);
    const dahl_commission_result_t *result = &state.result;
    printf("Fc %.5f length %.6f sigma0 %.3f inertia %.6f delay %.6f gain %.2f seconds %.3f\n", (double)result->Fc.best,
           (double)result->length.best, (double)result->sigma0.best, (double)result->inertia.best, (double)result->delay.best,
           (double)result->gain, (double)result->seconds);
    TEST_ASSERT_EQUAL(DAHL_COMMISSION_DONE, state.command.stage);
    assert_has(&result->Fc, PLAIN_FC, 0.01f);
    assert_has(&result->sigma0, PLAIN_SIGMA0, 0.05f);
    assert_has(&result->length, PLAIN_FC / PLAIN_SIGMA0, 0.05f);
    assert_has(&result->inertia, PLAIN_INERTIA, 0.01f);
    assert_has(&result->delay, DELAY, 0.15f);
    for (int bin = 0; bin < DAHL_COMMISSION_BINS; bin++) {
        TEST_ASSERT_FLOAT_WITHIN(0.01f * PLAIN_FC, PLAIN_LOAD, result->load[bin]);
    }
    TEST_ASSERT_FLOAT_WITHIN(0.001f, 0.95f, result->gain);
    TEST_ASSERT_EQUAL(0, result->elastic);
}

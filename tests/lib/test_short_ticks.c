/* SPDX-License-Identifier: MIT */
/*
 * Where a tick by counts goes: up to 8 counts take an entry of the table at once, which is what their cost rests on; all
 * others go by their digits, once. The digits are here a function of the test's own, which notes what it is called for.
 */
#include "../../lib/model/bristle_update.h"
#include "motions.h"
#include "plans.h"

#define ANSWER 123456789

static int calls;
static int32_t called_for;

int32_t dahl_step_large(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts)
{
    (void)plan;
    state->w = (int64_t)1 << 61;
    calls++;
    called_for = dcounts;
    return ANSWER;
}

static void test_short_ticks_take_their_entry(void)
{
    dahl_params_t p = params_for(0.1, 2.0f);
    dahl_plan_t plan = plan_for(&p);
    calls = 0;
    for (int32_t d = -DAHL_DIRECT_COUNTS_MAX; d <= DAHL_DIRECT_COUNTS_MAX; d++) {
        dahl_state_t torque = {0}, q30 = {0};
        long double w = d < 0 ? expm1l(reference_by_counts(&p).a * d) : -expm1l(-reference_by_counts(&p).a * d);
        assert_torque(w, &p, dahl_step_counts(&plan, &torque, d), DAHL_ULP_COUNTS);
        TEST_ASSERT_TRUE(fabsl(dahl_step_counts_q30(&plan, &q30, d) - w * 0x1p30L) <= 1.01L && q30.w == torque.w);
    }
    TEST_ASSERT_EQUAL_INT(0, calls);
}

static void test_the_rest_goes_by_digits_once(void)
{
    static const int32_t far[] = {9, 10, 16, 17, 4711, INT32_MAX, -9, -10, -16, -17, -4711, -INT32_MAX, INT32_MIN};
    dahl_params_t p = params_for(0.1, 2.0f);
    dahl_plan_t plan = plan_for(&p);
    for (size_t i = 0; i < sizeof far / sizeof far[0]; i++) {
        dahl_state_t state = {0};
        calls = 0;
        TEST_ASSERT_EQUAL_INT32(ANSWER, dahl_step_counts_q30(&plan, &state, far[i]));
        TEST_ASSERT_TRUE(calls == 1 && called_for == far[i]);
        TEST_ASSERT_TRUE(dahl_step_counts(&plan, &state, far[i]) == 1.0f);
        TEST_ASSERT_TRUE(calls == 2 && called_for == far[i]);
    }
}

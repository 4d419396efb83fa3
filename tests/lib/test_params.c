/* SPDX-License-Identifier: MIT */
/* The ends of the range of a plan, of dahl_set_torque and of dahl_change_plan. test_prepare_laws.c has the limits of
 * parameters. */
#include <float.h>

#include "plans.h"

#define TEXT_OF(x) #x
#define VERSION_OF(major, minor, patch) TEXT_OF(major) "." TEXT_OF(minor) "." TEXT_OF(patch)

static void test_version_and_limits_are_those_of_the_header(void)
{
    TEST_ASSERT_EQUAL_STRING(DAHL_VERSION, VERSION_OF(DAHL_VERSION_MAJOR, DAHL_VERSION_MINOR, DAHL_VERSION_PATCH));
    TEST_ASSERT_TRUE((double)DAHL_TORQUE_MIN == 0x1p-64 && (double)DAHL_TORQUE_MAX == 0x1p64);
    TEST_ASSERT_TRUE(DAHL_TRAVEL_MIN == 0x1p-30 && DAHL_TRAVEL_MAX == 0x1p20);
}

/* --- plans --------------------------------------------------------------------------------------------------------- */

/* The last bits of this travel are all ones: a unit more would carry into each entry of the plan. */
static void test_a_travel_whose_last_bits_are_ones(void)
{
    dahl_params_t p = {0x1.51d492p-3f, 0x1.37d6eep+0f, 0x1.dffdaap-1f};
    dahl_plan_t plan = plan_for(&p);
    TEST_ASSERT_EQUAL_HEX32(0x1e857baeu, plan.g[1].hi);
    TEST_ASSERT_EQUAL_HEX32(0x94cc33d1u, plan.g[1].lo);
}

/* --- dahl_set_torque ----------------------------------------------------------------------------------------------- */

/* F/Fc in Q62, a half rounded up. Below 2^-63 it is 0, and a subnormal F counts as 0. */
static void test_a_torque_far_below_Fc_is_rounded(void)
{
    static const struct {
        float Fc, F;
        int64_t w;
    } least[] = {{1, -0x1p-62f, -1}, {1, -0x1p-63f, -1}, {1, -0x1p-64f, 0}, {1, 0x1p-126f, 0}, {DAHL_TORQUE_MIN, 0x1p-126f, 1},
                 {DAHL_TORQUE_MIN, -0x1p-126f, -1}, {DAHL_TORQUE_MIN, 0x1.fffffcp-127f, 0}, {DAHL_TORQUE_MIN, -0x1p-149f, 0}};
    for (size_t i = 0; i < sizeof least / sizeof least[0]; i++) {
        dahl_params_t p = {1.0f, least[i].Fc, 0};
        dahl_plan_t plan = plan_for(&p);
        dahl_state_t state = {12345};
        dahl_set_torque(&plan, &state, least[i].F);
        TEST_ASSERT_TRUE(state.w == least[i].w);
    }
}

/* --- dahl_change_plan ---------------------------------------------------------------------------------------------- */

/* A change to just below 2^-62 of the stiffness leaves w = 0, also from beyond 1. So does a plan of zeros, before or after,
 * which keeps no torque that is set either. */
static void test_a_change_can_leave_no_torque(void)
{
    static const dahl_plan_t zero;
    dahl_params_t p1 = {16777214.0f * 0x1p20f, 8388699.0f, 0}, p2 = {16777032.0f * 0x1p-42f, 8388608.0f, 0};
    dahl_plan_t from = plan_for(&p1), to = plan_for(&p2);
    const int64_t most = ((int64_t)1 << 62) + ((int64_t)1 << 31) - 1;
    const struct {
        const dahl_plan_t *from, *to;
    } changes[] = {{&from, &to}, {&zero, &to}, {&from, &zero}, {&zero, &zero}};
    for (int i = 0; i < 8; i++) {
        dahl_state_t state = {i % 2 ? most : -most};
        dahl_change_plan(changes[i / 2].from, changes[i / 2].to, &state);
        TEST_ASSERT_TRUE(state.w == 0);
        dahl_set_torque(&zero, &state, 0.25f);
        TEST_ASSERT_TRUE(dahl_torque(&zero, &state) == 0.0f);
    }
}

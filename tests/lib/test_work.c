/* SPDX-License-Identifier: MIT */
/* The ends of the sums of dahl_work. test_element_properties.c has the integral of the torque. */
#include "dahl_parts.h"
#include "plans.h"

static void test_sums_carry_into_the_next_word(void)
{
    dahl_params_t p = params_for(1e-3, 0.5f);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    dahl_work_t sums = {{UINT32_MAX, UINT32_MAX, 5}, {UINT32_MAX, UINT32_MAX, UINT32_MAX, 7}};
    dahl_set_torque(&plan, &state, -p.Fc);
    (void)dahl_work_step_counts(&plan, &state, &sums, INT32_MIN);
    TEST_ASSERT_EQUAL_UINT32(0x7fffffffu, sums.counts[0]);
    TEST_ASSERT_EQUAL_UINT32(0, sums.counts[1]);
    TEST_ASSERT_EQUAL_UINT32(6, sums.counts[2]);
    (void)dahl_work_step_counts(&plan, &state, &sums, 1);
    TEST_ASSERT_EQUAL_UINT32(0, sums.way[2]);
    TEST_ASSERT_EQUAL_UINT32(8, sums.way[3]);
    dahl_work_t full = {{UINT32_MAX, UINT32_MAX, UINT32_MAX}, {0}}; /* after 2^65 ticks the counts wrap */
    (void)dahl_work_step_counts(&plan, &state, &full, 1);
    TEST_ASSERT_TRUE(full.counts[0] == 0 && full.counts[1] == 0 && full.counts[2] == 0);
}

/* Also results beyond the range of a float at both ends, and a difference of sums that agree in their upper 32 bits. */
static void test_the_work_of_slip_is_Fc_times_the_travel(void)
{
    const struct {
        dahl_params_t p;
        dahl_work_t sums;
        float work;
    } cases[] = {{{0x1p-30f, 1.0f, 0x1p-30f}, {{0}, {0}}, 0.0f},
                 {{0x1p-30f, 1.0f, 0x1p-30f}, {{1}, {0}}, 0x1p-30f},
                 {{1.0f, 0x1p63f, 0x1p63f}, {{3}, {0}}, 0x1.8p127f},
                 {{1e18f, 1e18f, 1e18f}, {{0, 0, 1}, {0}}, HUGE_VALF},
                 {{1e-19f, 1e-19f, 6e-20f}, {{1}, {0}}, 0.0f},
                 {{1.0f, 1.0f, 1.0f}, {{0x80000000u, 0, 1}, {0, 0, 0, 1u << 30}}, 0x1p31f}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        TEST_ASSERT_TRUE(dahl_work(&cases[i].p, &cases[i].sums) == cases[i].work);
    }
}

/* The returned energy, or the part that the bristle keeps, is below the resolution of a float. */
static void test_terms_below_the_resolution_are_dropped(void)
{
    dahl_params_t small = {1.0f, 0x1p-64f, 0x1p-64f}, fast = {0x1p19f, 1.0f, 1.0f};
    dahl_plan_t plan = plan_for(&small);
    dahl_state_t state = {0};
    dahl_work_t sums = {{0}, {0}};
    dahl_set_torque(&plan, &state, small.Fc);
    (void)dahl_work_step_counts(&plan, &state, &sums, -1);
    TEST_ASSERT_TRUE(dahl_work(&small, &sums) == 0.0f && !signbit(dahl_work(&small, &sums)));

    dahl_work_t slid = {{0}, {0}};
    plan = plan_for(&fast);
    dahl_set_torque(&plan, &state, nextafterf(fast.Fc, 0));
    (void)dahl_work_step_counts(&plan, &state, &slid, INT32_MAX);
    TEST_ASSERT_TRUE(slid.way[0] != 0 || slid.way[1] != 0);
    TEST_ASSERT_TRUE(dahl_work(&fast, &slid) == 0x1p31f);
}

/* SPDX-License-Identifier: MIT */
/* Limits of parameters in every prepare, and the ends of the range of dahl_set_torque and dahl_change_plan. */
#include <float.h>

#include "dahl_float.h"
#include "dahl_frames.h"
#include "models.h"
#include "plans.h"

#define TEXT_OF(x) #x
#define VERSION_OF(major, minor, patch) TEXT_OF(major) "." TEXT_OF(minor) "." TEXT_OF(patch)

static void test_version_and_limits_are_those_of_the_header(void)
{
    TEST_ASSERT_EQUAL_STRING(DAHL_VERSION, VERSION_OF(DAHL_VERSION_MAJOR, DAHL_VERSION_MINOR, DAHL_VERSION_PATCH));
    TEST_ASSERT_TRUE((double)DAHL_TORQUE_MIN == 0x1p-64 && (double)DAHL_TORQUE_MAX == 0x1p64);
    TEST_ASSERT_TRUE(DAHL_TRAVEL_MIN == 0x1p-30 && DAHL_TRAVEL_MAX == 0x1p20);
}

/* --- refusals ------------------------------------------------------------------------------------------------------ */

static dahl_err_t float_prepare(any_plan_t *plan, const set_t *set)
{
    return dahl_float_prepare((dahl_float_plan_t *)(void *)plan, &set->p);
}

/* Each prepare with a good `more`; theta_per_count is not read, may be 0, or is required. */
enum { NOT_READ, MAY_BE_0, REQUIRED };
#define DIRECTED_ROW(name, ...) {name##_prepare, 1, REQUIRED},
static const struct {
    dahl_err_t (*prepare)(any_plan_t *, const set_t *);
    float more;
    int counts;
} all[] = {{dahl_model_prepare, 0, MAY_BE_0}, {float_prepare, 0, MAY_BE_0}, {angle_prepare, 0, NOT_READ},
           {slip_prepare, 1, REQUIRED},       {slip_prepare, 8, REQUIRED},  {breakaway_prepare, 0.5f, REQUIRED},
           DAHL_FRAMES_DIRECTED_MODELS(DIRECTED_ROW)};
#define ALL (sizeof all / sizeof all[0])

/* An error keeps the plan; the memory behind the plan is never written. */
static dahl_err_t try(size_t which, set_t set)
{
    any_plan_t plan[2], untouched[2];
    memset(plan, 0x5a, sizeof plan);
    memcpy(untouched, plan, sizeof plan);
    dahl_err_t err = all[which].prepare(plan, &set);
    TEST_ASSERT_TRUE(err == DAHL_OK || memcmp(plan, untouched, sizeof plan[0]) == 0);
    TEST_ASSERT_EQUAL_MEMORY(&untouched[1], &plan[1], sizeof plan[1]);
    return err;
}

/* Limits of sigma0, Fc, theta_per_count and of the travel of a count. test_prepare_laws.c has any other parameters. */
static void test_both_sides_of_each_limit(void)
{
    enum { OK = DAHL_OK, PARAM = DAHL_ERR_PARAM, RANGE = DAHL_ERR_RANGE };
    const float least = DAHL_TORQUE_MIN, below = nextafterf(least, 0.0f), above = DAHL_TORQUE_MAX, top = nextafterf(above, 0.0f);
    const float slow = (float)DAHL_TRAVEL_MIN, fast = (float)DAHL_TRAVEL_MAX;
    const struct {
        float sigma0, Fc, theta;
        int code, is_of_counts;
    } cases[] = {{least, least, 1e-3f, OK, 0},    {top, top, 1e-3f, OK, 0},       {below, least, 1e-3f, RANGE, 0},
                 {least, below, 1e-3f, RANGE, 0}, {above, top, 1e-3f, RANGE, 0},  {top, above, 1e-3f, RANGE, 0},
                 {1e-45f, 1.0f, 1e-3f, RANGE, 0}, {below, below, below, RANGE, 0}, {1.0f, 1.0f, slow, OK, 1},
                 {1.0f, 1.0f, nextafterf(slow, 0.0f), RANGE, 1}, {1.0f, 1.0f, fast, RANGE, 1},
                 {1.0f, 1.0f, nextafterf(fast, 0.0f), OK, 1}, {1.0f, 1.0f, 1e-40f, RANGE, 1}, {1e-19f, 1e19f, 1e20f, RANGE, 1},
                 {slow, 1.0f, 1.0f, OK, 1}, {nextafterf(slow, 0.0f), 1.0f, 1.0f, RANGE, 1}, {-0.0f, 1.0f, 1.0f, PARAM, 0},
                 {1.0f, -1e-45f, 1.0f, PARAM, 0}, {1.0f, 1.0f, -1.0f, PARAM, 1}, {-1.0f, -1.0f, 1e-3f, PARAM, 0},
                 {HUGE_VALF, 1.0f, 1.0f, PARAM, 0}, {1.0f, -HUGE_VALF, 1.0f, PARAM, 0}, {1.0f, 1.0f, NAN, PARAM, 1}};
    for (size_t k = 0; k < ALL * (sizeof cases / sizeof cases[0]); k++) {
        const size_t which = k % ALL, i = k / ALL;
        const set_t set = {{cases[i].sigma0, cases[i].Fc, cases[i].theta}, all[which].more};
        if (set.more == 8 && cases[i].code != PARAM) { /* the other elements exceed the limits earlier */
            continue;
        }
        TEST_ASSERT_EQUAL_INT(cases[i].is_of_counts && all[which].counts == NOT_READ ? OK : cases[i].code, try(which, set));
    }
    for (size_t which = 0; which < ALL; which++) {
        const set_t set = {{1.0f, 1.0f, which % 2 ? 0.0f : -0.0f}, all[which].more};
        TEST_ASSERT_EQUAL_INT(all[which].counts == REQUIRED ? PARAM : OK, try(which, set));
    }
}

static void test_limits_of_the_parameters_that_one_model_has(void)
{
    const struct {
        dahl_err_t (*prepare)(any_plan_t *, const set_t *);
        float more, theta;
        dahl_err_t code;
    } cases[] = {{slip_prepare, 0, 1e-3f, DAHL_ERR_PARAM},
                 {slip_prepare, DAHL_SLIP_MAX + 1, 1e-3f, DAHL_ERR_RANGE},
                 {slip_prepare, 0x1.fffffep31f, 1e-3f, DAHL_ERR_RANGE},
                 {asymmetric_prepare, NAN, 1e-3f, DAHL_ERR_PARAM},
                 {asymmetric_prepare, -1, 1e-3f, DAHL_ERR_PARAM},
                 {asymmetric_prepare, 1e-20f, 1e-3f, DAHL_ERR_RANGE},
                 {asymmetric_prepare, 0x1p22f, 0x1p-9f, DAHL_ERR_RANGE}, /* the travel backward is too small */
                 {asymmetric_prepare, 0x1p21f, 0x1p-9f, DAHL_OK},
                 {asymmetric_prepare, 0x1p-20f, 1.0f, DAHL_ERR_RANGE}, /* too large */
                 {breakaway_prepare, 0, 1e-3f, DAHL_ERR_PARAM},
                 {breakaway_prepare, -1e-45f, 1e-3f, DAHL_ERR_PARAM},
                 {breakaway_prepare, NAN, 1e-3f, DAHL_ERR_PARAM},
                 {breakaway_prepare, HUGE_VALF, 1e-3f, DAHL_ERR_PARAM},
                 {breakaway_prepare, 1, 1e-3f, DAHL_ERR_RANGE},
                 {breakaway_prepare, 1e-45f, 0x1p-30f, DAHL_OK},
                 {breakaway_prepare, 0x1.fffffep-1f, 0x1.fffffep19f, DAHL_OK}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        for (size_t which = 0; which < ALL; which++) {
            const set_t set = {{1.0f, 1.0f, cases[i].theta}, cases[i].more};
            TEST_ASSERT_TRUE(all[which].prepare != cases[i].prepare || try(which, set) == cases[i].code);
        }
    }
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

/* SPDX-License-Identifier: MIT */
/* Parameters, torques and plans that are set from outside: cases P14 and P15, and the limits that dahl.h states. */
#include <float.h>
#include <string.h>

#include "dahl_float.h"
#include "motions.h"
#include "plans.h"

#define TEXT_OF(x) #x
#define VERSION_OF(major, minor, patch) TEXT_OF(major) "." TEXT_OF(minor) "." TEXT_OF(patch)

static void test_version(void)
{
    TEST_ASSERT_EQUAL_STRING(DAHL_VERSION, VERSION_OF(DAHL_VERSION_MAJOR, DAHL_VERSION_MINOR, DAHL_VERSION_PATCH));
}

/* The other tests see a bound that is too small; one that grows would only make them lenient. */
static void test_bounds_are_no_wider_than_promised(void)
{
    TEST_ASSERT_TRUE(DAHL_ULP_COUNTS <= 0.52 && DAHL_ULP_ANGLE <= 0.6);
    TEST_ASSERT_TRUE(DAHL_ERROR_Q30 <= 1.21e-9 && DAHL_Q30 == 0x1p-30);
    TEST_ASSERT_TRUE(DAHL_FLOAT_ERROR <= 3e-7 && (double)DAHL_TORQUE_MIN == 0x1p-64 && (double)DAHL_TORQUE_MAX == 0x1p64);
    TEST_ASSERT_TRUE(DAHL_TRAVEL_MIN == 0x1p-30 && DAHL_TRAVEL_MAX == 0x1p20);
}

/* The plan is untouched on an error, and what lies behind it always. */
static dahl_err_t try(float sigma0, float Fc, float theta_per_count)
{
    dahl_params_t p = {sigma0, Fc, theta_per_count};
    dahl_plan_t plan[2], untouched[2];
    memset(plan, 0x5a, sizeof plan);
    memcpy(untouched, plan, sizeof plan);
    dahl_err_t err = dahl_prepare(plan, &p);
    TEST_ASSERT_TRUE(err == DAHL_OK || memcmp(plan, untouched, sizeof plan[0]) == 0);
    TEST_ASSERT_EQUAL_MEMORY(&untouched[1], &plan[1], sizeof plan[1]);
    return err;
}

static void test_not_a_number_zero_negative(void)
{
    static const float bad[] = {0.0f, -0.0f, -1.0f, -1e-45f, NAN, -NAN, HUGE_VALF, -HUGE_VALF};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(bad[i], 1.0f, 1e-3f));
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(1.0f, bad[i], 1e-3f));
        TEST_ASSERT_EQUAL_INT(i < 2 ? DAHL_OK : DAHL_ERR_PARAM, try(1.0f, 1.0f, bad[i]));
    }
}

/* Of two bad parameters the graver one names the error; two alike do not cancel. */
static void test_two_bad_parameters(void)
{
    const float below = nextafterf(DAHL_TORQUE_MIN, 0.0f);
    static const float none[] = {0.0f, -1.0f, NAN};
    for (size_t i = 0; i < sizeof none / sizeof none[0]; i++) {
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(none[i], none[i], 1e-3f));
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(none[i], below, 1e-3f));
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(below, none[i], 1e-3f));
        TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(none[i], none[i], none[i]));
    }
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(below, below, 1e-3f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(below, below, below));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(below, below, NAN));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_PARAM, try(1.0f, NAN, NAN));
}

static void test_range_of_torque(void)
{
    const float below = nextafterf(DAHL_TORQUE_MIN, 0.0f), above = DAHL_TORQUE_MAX, top = nextafterf(above, 0.0f);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, try(DAHL_TORQUE_MIN, DAHL_TORQUE_MIN, 1e-3f));
    TEST_ASSERT_EQUAL_INT(DAHL_OK, try(top, top, 1e-3f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(below, DAHL_TORQUE_MIN, 1e-3f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(DAHL_TORQUE_MIN, below, 1e-3f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(above, top, 1e-3f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(top, above, 1e-3f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(1e-45f, 1.0f, 1e-3f));
}

static void test_range_of_travel(void)
{
    const float least = (float)DAHL_TRAVEL_MIN, most = (float)DAHL_TRAVEL_MAX;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, try(1.0f, 1.0f, least));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(1.0f, 1.0f, nextafterf(least, 0.0f)));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(1.0f, 1.0f, most));
    TEST_ASSERT_EQUAL_INT(DAHL_OK, try(1.0f, 1.0f, nextafterf(most, 0.0f)));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(1.0f, 1.0f, 1e-40f));
    TEST_ASSERT_EQUAL_INT(DAHL_ERR_RANGE, try(1e-19f, 1e19f, 1e20f));
}

/* Without counts the table is zero, the stiffest bristle's too: counts move nothing. */
static void test_no_counts(void)
{
    for (int k = -63; k < 64; k++) {
        dahl_params_t p = {ldexpf(1.0f, k), ldexpf(1.0f, -k), k % 2 ? 0.0f : -0.0f};
        dahl_plan_t plan = plan_for(&p);
        dahl_state_t state = {1};
        for (size_t n = 0; n < sizeof plan.g / sizeof plan.g[0]; n++) {
            TEST_ASSERT_TRUE(plan.g[n].hi == 0 && plan.g[n].lo == 0);
        }
        (void)dahl_step_counts_q30(&plan, &state, INT32_MIN);
        TEST_ASSERT_TRUE(state.w == 1);
    }
}

/* Every theta_per_count but 0 is one, the powers of two too, whose bits are few. */
static void test_counts_of_any_power_of_two(void)
{
    for (int k = -63; k < 64; k++) {
        dahl_params_t p = {ldexpf(1.0f, k < 0 ? -k : 0), ldexpf(1.0f, k < 0 ? 0 : k), ldexpf(1.0f, k)};
        dahl_plan_t plan = plan_for(&p);
        dahl_state_t state = {0};
        assert_torque(-expm1l(-1), &p, dahl_step_counts(&plan, &state, 1), DAHL_ULP_COUNTS);
    }
}

/* Travels just off a power of two, which truncation in dahl_prepare may bring below it. */
static void test_travel_just_below_a_power_of_two(void)
{
    for (int k = -29; k < 20; k++) {
        dahl_params_t p = {1.0f, 0.001f, ldexpf(0.001f, k)};
        dahl_plan_t plan = plan_for(&p);
        dahl_state_t state = {0};
        assert_torque(-expm1l(-reference_by_counts(&p).a), &p, dahl_step_counts(&plan, &state, 1), DAHL_ULP_COUNTS);
        TEST_ASSERT_TRUE(state.w > 0);
    }
}

/* A travel whose last bits are all ones is truncated: one unit more would carry into every entry. */
static void test_bits_of_a_travel_of_ones(void)
{
    dahl_params_t p = {0x1.51d492p-3f, 0x1.37d6eep+0f, 0x1.dffdaap-1f};
    dahl_plan_t plan = plan_for(&p);
    TEST_ASSERT_EQUAL_HEX32(0x1e857baeu, plan.g[1].hi);
    TEST_ASSERT_EQUAL_HEX32(0x94cc33d1u, plan.g[1].lo);
}

/* Torque in, torque out: the same float while |F| >= 2^-36 Fc; clamped; NaN ignored. */
static void test_set_torque(void)
{
    dahl_params_t p = params_for(0.01, 2.739f);
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {0};
    motion_t m = MOTION_START;
    for (int i = 0; i < 100000; i++) {
        float size = ldexpf((float)(motion_random(&m) >> 2 | 0x40000000u) * p.Fc, -31 - i % 35);
        float F = i % 2 ? size : -size;
        dahl_set_torque(&plan, &state, F);
        TEST_ASSERT_TRUE(dahl_torque(&plan, &state) == F);
    }
    int64_t before = state.w;
    dahl_set_torque(&plan, &state, NAN);
    TEST_ASSERT_TRUE(state.w == before);
    static const float clamped[] = {2.739f, 2.7390003f, 1e30f, HUGE_VALF};
    for (size_t i = 0; i < 4; i++) {
        dahl_set_torque(&plan, &state, clamped[i]);
        TEST_ASSERT_TRUE(dahl_torque(&plan, &state) == p.Fc && state.w == (int64_t)1 << 62);
        dahl_set_torque(&plan, &state, -clamped[i]);
        TEST_ASSERT_TRUE(dahl_torque(&plan, &state) == -p.Fc);
    }
    dahl_set_torque(&plan, &state, 1e-40f);
    TEST_ASSERT_TRUE(state.w == 0);
    dahl_set_torque(&plan, &state, 0.0f);
    TEST_ASSERT_TRUE(dahl_torque(&plan, &state) == 0.0f);
}

/* F/Fc in Q62, rounded, over all the range that both can have: nothing is left below 2^-63. */
static void test_set_torque_far_below_Fc(void)
{
    motion_t m = MOTION_START;
    for (int i = 0; i < 100000; i++) {
        float of_one = 1.0f + (float)(motion_random(&m) >> 9) * 0x1p-23f;
        dahl_params_t p = {1.0f, ldexpf(1.0f + (float)(motion_random(&m) >> 9) * 0x1p-23f, i % 128 - 64), 0};
        dahl_plan_t plan = plan_for(&p);
        dahl_state_t state = {12345};
        float F = ldexpf(of_one, -126 + i % 190);
        if (F < p.Fc) {
            long double exact = ldexpl((long double)F / p.Fc, 62);
            dahl_set_torque(&plan, &state, F);
            TEST_ASSERT_TRUE(fabsl((long double)state.w - exact) <= 0.5L + exact * LDBL_EPSILON);
        }
    }
    dahl_params_t p = {1.0f, 1.0f, 0};
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state;
    for (int k = 62; k < 126; k++) { /* a half goes up, less than that to none */
        dahl_set_torque(&plan, &state, ldexpf(-1.0f, -k));
        TEST_ASSERT_TRUE(state.w == (k <= 63 ? -1 : 0));
    }
}

/* The least torque beside the least Fc: the smallest normal float is one unit of w, a subnormal one is none. */
static void test_set_least_torques(void)
{
    dahl_params_t p = {1.0f, DAHL_TORQUE_MIN, 0};
    dahl_plan_t plan = plan_for(&p);
    dahl_state_t state = {12345};
    dahl_set_torque(&plan, &state, 0x1p-126f);
    TEST_ASSERT_TRUE(state.w == 1);
    dahl_set_torque(&plan, &state, -0x1p-126f);
    TEST_ASSERT_TRUE(state.w == -1);
    dahl_set_torque(&plan, &state, 0x1.fffffcp-127f);
    TEST_ASSERT_TRUE(state.w == 0);
    state.w = 12345;
    dahl_set_torque(&plan, &state, -0x1p-149f);
    TEST_ASSERT_TRUE(state.w == 0);
}

/* Torque of any state: half an ulp of itself and 0.012, as torque.h says; where Q30 says +-1 it is +-Fc. */
static void test_torque_of_any_state(void)
{
    motion_t m = MOTION_START;
    for (int i = 0; i < 100000; i++) {
        dahl_params_t p = {1.0f, ldexpf((float)(motion_random(&m) >> 8 | 0x800000u), i % 128 - 87), 0};
        dahl_plan_t plan = plan_for(&p);
        uint64_t bits = (uint64_t)motion_random(&m) << 32 | motion_random(&m);
        dahl_state_t state = {(int64_t)((bits >> 2 | 1) >> i % 61)}, mirrored;
        state.w += state.w == 0;
        mirrored.w = -state.w;
        float F = dahl_torque(&plan, &state);
        TEST_ASSERT_TRUE(fabsl(F - ldexpl(state.w, -62) * p.Fc) <= 0.512L * ulp_of(F));
        TEST_ASSERT_TRUE(dahl_torque(&plan, &mirrored) == -F);
        state.w = ((int64_t)1 << 62) + (int64_t)(bits >> 31 & 0xffffffffu) - ((int64_t)1 << 31);
        TEST_ASSERT_TRUE(dahl_torque(&plan, &state) == p.Fc);
    }
}

/* P15: what dahl_change_plan keeps. F is expected clamped to the new Fc, scaled where the bristle got softer. */
static void check_change(float s1, float Fc1, float s2, float Fc2, float F)
{
    dahl_params_t p1 = {s1, Fc1, 0}, p2 = {s2, Fc2, 0};
    dahl_plan_t from = plan_for(&p1), to = plan_for(&p2);
    dahl_state_t state;
    dahl_set_torque(&from, &state, F);
    long double F0 = state.w * 0x1p-62L * Fc1, expected = F0 * fminl(1.0L, (long double)s2 / s1);
    expected = fmaxl(-Fc2, fminl(Fc2, expected));
    dahl_change_plan(&from, &to, &state);
    long double w = state.w * 0x1p-62L, F1 = w * Fc2;
    TEST_ASSERT_TRUE(fabsl(w) <= 1 && fabsl(F1 - expected) <= 0x1p-30L * fabsl(expected) + 1e-18L * Fc2);
    TEST_ASSERT_TRUE(F1 * F1 / s2 <= F0 * F0 / s1 * (1 + 1e-18L)); /* stored energy; the factor is long double's own */
}

static void test_p15_change_of_parameters(void)
{
    check_change(100, 1, 100, 0.5f, 0.9f);   /* abs(F) > new Fc */
    check_change(100, 1, 100, 0.5f, -0.9f);
    check_change(100, 1, 100, 3, 0.9f);      /* more Fc: F stays */
    check_change(100, 1, 300, 1, 0.9f);      /* stiffer: F stays */
    check_change(100, 1, 30, 1, 0.9f);       /* softer: deflection stays */
    check_change(100, 1, 30, 0.1f, 0.9f);
    check_change(100, 1, 100, 1, 0);
    check_change(1e-10f, 1e-15f, 1e15f, 1e10f, 1e-15f);
    check_change(1e15f, 1e10f, 1e-10f, 1e-15f, 1e10f);
    motion_t m = MOTION_START;
    for (int i = 0; i < 100000; i++) {
        float x[5];
        for (int k = 0; k < 5; k++) {
            x[k] = ldexpf(1.0f + (float)(motion_random(&m) >> 8) * 0x1p-24f, (int)(motion_random(&m) % 20u) - 10);
        }
        check_change(x[0], x[1], x[2], x[3], i % 2 ? x[4] : -x[4]);
    }
}

/* No torque stays none, however much Fc shrinks. */
static void test_p15_relaxed_stays_relaxed(void)
{
    for (int k = 0; k <= 124; k++) {
        dahl_params_t p1 = {1, 0x1p62f, 0}, p2 = {1, ldexpf(0x1p62f, -k), 0};
        dahl_plan_t from = plan_for(&p1), to = plan_for(&p2);
        dahl_state_t state = {0};
        dahl_change_plan(&from, &to, &state);
        TEST_ASSERT_TRUE(state.w == 0);
        dahl_change_plan(&to, &from, &state);
        TEST_ASSERT_TRUE(state.w == 0);
    }
}

/* The smallest w against any growth that parameters allow: 2^k of it, never more than 1; and the way back. */
static void test_p15_growth_of_the_smallest_torque(void)
{
    for (int k = 0; k <= 124; k++) {
        dahl_params_t p1 = {1, 0x1p62f, 0}, p2 = {1, ldexpf(0x1p62f, -k), 0};
        dahl_plan_t from = plan_for(&p1), to = plan_for(&p2);
        for (int64_t w = -1; w <= 1; w += 2) {
            dahl_state_t state = {w};
            dahl_change_plan(&from, &to, &state);
            TEST_ASSERT_TRUE(state.w == w * ((int64_t)1 << (k < 62 ? k : 62)));
            dahl_change_plan(&to, &from, &state);
            TEST_ASSERT_TRUE(state.w == (k <= 62 ? w : 0));
        }
    }
}

/* Softer by just below 2^-62, where the travels of both bristles have mantissas that are neighbours: nothing is left, also of
 * the 2^31 that a step may pass 1 by. */
static void test_p15_the_least_that_is_left(void)
{
    dahl_params_t p1 = {16777214.0f * 0x1p20f, 8388699.0f, 0}, p2 = {16777032.0f * 0x1p-42f, 8388608.0f, 0};
    dahl_plan_t from = plan_for(&p1), to = plan_for(&p2);
    TEST_ASSERT_EQUAL_UINT32(from.a_mantissa / 2 - 1, to.a_mantissa / 2);
    const int64_t most = ((int64_t)1 << 62) + ((int64_t)1 << 31) - 1;
    dahl_state_t states[2] = {{most}, {-most}};
    for (int i = 0; i < 2; i++) {
        dahl_change_plan(&from, &to, &states[i]);
        TEST_ASSERT_TRUE(states[i].w == 0);
    }
}

/* The same plan leaves the torque, and never adds to the stored energy however often it is changed. */
static void test_p15_no_energy_from_changes(void)
{
    dahl_params_t p[3] = {{100, 1, 0}, {170, 0.6f, 0}, {33, 2, 0}};
    dahl_plan_t plan[3] = {plan_for(&p[0]), plan_for(&p[1]), plan_for(&p[2])};
    dahl_state_t state;
    dahl_set_torque(&plan[0], &state, 0.99f);
    long double energy = 1;
    for (int i = 0; i < 3000; i++) {
        long double F = state.w * 0x1p-62L * p[i % 3].Fc, now = F * F / (2 * p[i % 3].sigma0);
        TEST_ASSERT_TRUE(now <= energy);
        energy = now;
        dahl_change_plan(&plan[i % 3], &plan[(i + 1) % 3], &state);
    }
}

/* A w that no call leaves means nothing, but is no undefined behaviour (seen under the sanitizers); and whatever it is, the
 * calls that set a state leave a good one. */
static void test_any_word_as_a_state(void)
{
    static const int64_t words[] = {INT64_MIN, INT64_MIN + 1, -((int64_t)1 << 62) - ((int64_t)1 << 31) - 1,
                                    ((int64_t)1 << 62) + ((int64_t)1 << 31), INT64_MAX};
    static const float angles[] = {0.0f, 1e-20f, 1e-3f, -1e-3f, 1.0f, -1.0f, 1e30f, HUGE_VALF, -HUGE_VALF, NAN};
    static const int32_t counts[] = {0, 1, -1, 8, -8, 9, -9, INT32_MAX, INT32_MIN};
    static const dahl_plan_t zero;
    dahl_params_t p = {100.0f, 0.5f, 1e-3f};
    const dahl_plan_t plans[2] = {plan_for(&p), zero};
    for (size_t i = 0; i < 2 * sizeof words / sizeof words[0]; i++) {
        const dahl_plan_t *plan = &plans[i % 2];
        dahl_state_t state;
        for (size_t k = 0; k < sizeof counts / sizeof counts[0]; k++) {
            state.w = words[i / 2];
            (void)dahl_step_counts(plan, &state, counts[k]);
            state.w = words[i / 2];
            (void)dahl_step_counts_q30(plan, &state, counts[k]);
        }
        for (size_t k = 0; k < sizeof angles / sizeof angles[0]; k++) {
            state.w = words[i / 2];
            (void)dahl_step(plan, &state, angles[k]);
        }
        state.w = words[i / 2];
        (void)dahl_torque(plan, &state);
        dahl_change_plan(plan, &plans[0], &state);
        TEST_ASSERT_TRUE(fabsf(dahl_torque(&plans[0], &state)) <= 0.5f);
        state.w = words[i / 2];
        dahl_set_torque(plan, &state, 0.25f);
        TEST_ASSERT_TRUE(dahl_torque(plan, &state) == (i % 2 ? 0.0f : 0.25f));
    }
}

static void test_p15_a_plan_of_zeros_carries_no_torque(void)
{
    const dahl_params_t p = {100.0f, 0.5f, 1e-3f};
    const dahl_plan_t zero = {0};
    dahl_plan_t plan;
    TEST_ASSERT_EQUAL(DAHL_OK, dahl_prepare(&plan, &p));
    const dahl_plan_t *from[] = {&zero, &plan, &zero}, *to[] = {&plan, &zero, &zero};
    for (size_t i = 0; i < 3; i++) {
        dahl_state_t state = {(int64_t)1 << 61};
        dahl_change_plan(from[i], to[i], &state);
        TEST_ASSERT_TRUE(state.w == 0);
    }
}

/* SPDX-License-Identifier: MIT */
/* Any mix of parts: the sum of their torques against the sum of their references, on every hard motion and for any Fc. */
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "motions.h"
#include "reference.h"
#include "slip_reference.h"

#ifndef TEST_TICKS
#define TEST_TICKS 100000
#endif

#define PARTS_MOST 8

/* Parts with their references: Dahl elements, and of slip elements at most one. */
typedef struct {
    dahl_plan_t plan[PARTS_MOST];
    dahl_state_t state[PARTS_MOST];
    reference_t exact[PARTS_MOST];
    float Fc[PARTS_MOST];
    dahl_slip_params_t slip_params;
    dahl_slip_plan_t slip_plan;
    dahl_slip_state_t slip_state;
    slip_reference_t slip_exact;
    dahl_part_t part[PARTS_MOST];
    uint32_t count;
    long double sum; /* of Fc */
} mix_t;

static mix_t mix; /* small cores have a small stack */

static void add_dahl(mix_t *to, double travel, float Fc)
{
    const uint32_t k = to->count++;
    const dahl_params_t params = {(float)(travel * (double)Fc / 3.8e-4), Fc, 3.8e-4f};
    const dahl_part_t part = DAHL_PART(&to->plan[k], &to->state[k]);
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_prepare(&to->plan[k], &params));
    to->state[k].w = 0;
    to->exact[k] = reference_by_counts(&params);
    to->Fc[k] = Fc;
    to->sum += Fc;
    to->part[k] = part;
}

static void add_slip(mix_t *to, double travel, float Fc)
{
    const dahl_slip_params_t params = {3, 3.8e-4f, {(float)(travel * (double)Fc / 3.8e-4), Fc, Fc}, {Fc, 0.3f * Fc, 0.07f * Fc}};
    const dahl_part_t part = DAHL_SLIP_PART(&to->slip_plan, &to->slip_state);
    to->slip_params = params;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_slip_prepare(&to->slip_plan, &to->slip_params));
    memset(&to->slip_state, 0, sizeof to->slip_state);
    to->slip_exact = slip_reference(&to->slip_params);
    to->Fc[to->count] = 0; /* not a Dahl element */
    to->sum += slip_reference_Fc(&to->slip_params);
    to->part[to->count++] = part;
}

static long double exact_torque(mix_t *to, int32_t dcounts)
{
    long double F = 0;
    for (uint32_t k = 0; k < to->count; k++) {
        F += to->Fc[k] > 0 ? reference_move(&to->exact[k], dcounts) * to->Fc[k] : slip_reference_move(&to->slip_exact, dcounts);
    }
    return F;
}

/* Worst error in ulp of the sum of Fc. */
static double run(mix_t *to, motion_fn next, int ticks)
{
    motion_t motion = MOTION_START;
    long double worst = 0;
    for (int t = 0; t < ticks; t++) {
        int32_t d = next(&motion);
        long double error = fabsl(dahl_parallel_step_counts(to->part, to->count, d) - exact_torque(to, d));
        worst = error > worst ? error : worst;
    }
    return (double)(worst / ulp_of_sum(to->sum));
}

/* Two alike; four of different travel; a Dahl element with slip elements; five, of which one is most; the smallest first. */
static void make(mix_t *to, int kind)
{
    to->count = 0;
    to->sum = 0;
    switch (kind) {
    case 0:
        add_dahl(to, 1e-3, 2.739f);
        add_dahl(to, 1e-3, 2.739f);
        break;
    case 1:
        for (int k = 0; k < 4; k++) {
            add_dahl(to, 1e-6 * (double)(k * k * k * k + 1), 0.3f * (float)(k + 1));
        }
        break;
    case 2:
        add_dahl(to, 0.02, 1.9f);
        add_slip(to, 1e-4, 1.3f);
        break;
    case 3:
        for (int k = 0; k < 4; k++) {
            add_dahl(to, 0.3, ldexpf(1.7f, -9 * k));
        }
        add_slip(to, 0.01, 0.02f);
        break;
    default:
        for (int k = 0; k < 4; k++) {
            add_dahl(to, 1e-8, ldexpf(1.99f, 32 * k - 40));
        }
        break;
    }
}

#define KINDS 5

static void test_guarantee(void)
{
    double over_all = 0;
    for (size_t m = 0; m < MOTIONS; m++) {
        for (int kind = 0; kind < KINDS; kind++) {
            make(&mix, kind);
            double worst = run(&mix, motions[m].next, TEST_TICKS);
            printf("%-8s mix %d  worst %.4f ulp of the sum of Fc\n", motions[m].name, kind, worst);
            TEST_ASSERT_TRUE_MESSAGE(worst <= (kind == 2 || kind == 3 ? DAHL_ULP_PARTS : DAHL_ULP_COUNTS), motions[m].name);
            over_all = worst > over_all ? worst : over_all;
        }
    }
    TEST_ASSERT_TRUE(over_all > 0.49); /* half an ulp is the rounding to float: the comparison does compare */
}

/* F / sum of Fc in Q30 against the same references: Dahl elements alone have no slip element's error. */
static double worst_q30(mix_t *to, motion_fn next, int ticks)
{
    int32_t shares[PARTS_MOST];
    motion_t motion = MOTION_START;
    long double worst = 0;
    dahl_parallel_shares(shares, to->part, to->count);
    for (int t = 0; t < ticks; t++) {
        int32_t d = next(&motion);
        long double ratio = dahl_parallel_step_counts_q30(to->part, shares, to->count, d) * (long double)DAHL_Q30;
        long double error = fabsl(ratio - exact_torque(to, d) / to->sum);
        worst = error > worst ? error : worst;
    }
    return (double)worst;
}

static void test_guarantee_q30(void)
{
    double over_all = 0;
    for (size_t m = 0; m < MOTIONS; m++) {
        for (int kind = 0; kind < KINDS; kind++) {
            make(&mix, kind);
            double worst = worst_q30(&mix, motions[m].next, TEST_TICKS), bound = DAHL_PARALLEL_ERROR_Q30(mix.count);
            bound -= kind == 2 || kind == 3 ? 0 : DAHL_SLIP_ERROR_Q30 - DAHL_ERROR_Q30;
            printf("%-8s mix %d  worst %.2e of the sum of Fc, bound %.2e\n", motions[m].name, kind, worst, bound);
            TEST_ASSERT_TRUE_MESSAGE(worst <= bound, motions[m].name);
            over_all = worst > over_all ? worst : over_all;
        }
    }
    TEST_ASSERT_TRUE(over_all > 0.5 * DAHL_Q30);
}

/* Parts at Fc are +-2^30, exactly; those beside one whose Fc is far larger have no share, and one alone has all. */
static void check_ends_q30(mix_t *to)
{
    int32_t shares[PARTS_MOST];
    uint32_t whole = 0;
    dahl_parallel_shares(shares, to->part, to->count);
    for (uint32_t k = 0; k < to->count; k++) {
        long double exact = to->Fc[k] / to->sum * 0x1p31L;
        TEST_ASSERT_TRUE(shares[k] <= 0 && fabsl(exact + shares[k]) < 1);
        whole -= (uint32_t)shares[k];
    }
    TEST_ASSERT_EQUAL_HEX32(0x80000000u, whole);
    (void)dahl_parallel_step_counts_q30(to->part, shares, to->count, INT32_MAX); /* a state errs by 2^-31 at most */
    TEST_ASSERT_EQUAL_INT32(1 << 30, dahl_parallel_step_counts_q30(to->part, shares, to->count, INT32_MAX));
    (void)dahl_parallel_step_counts_q30(to->part, shares, to->count, INT32_MIN);
    TEST_ASSERT_EQUAL_INT32(-(1 << 30), dahl_parallel_step_counts_q30(to->part, shares, to->count, INT32_MIN));
}

/* Any number of parts, any Fc: exponents that are near, far apart, and at both ends. */
static void test_any_parts(void)
{
    static const uint32_t spreads[] = {1, 8, 40, 112};
    motion_t m = MOTION_START;
    for (int i = 0; i < (TEST_TICKS < 20000 ? 200 : 10000); i++) {
        uint32_t exponents = spreads[i % 4];
        mix.count = 0;
        mix.sum = 0;
        for (uint32_t left = motion_random(&m) % PARTS_MOST + 1; left > 0; left--) {
            float mantissa = 1.0f + (float)(motion_random(&m) >> 9) * 0x1p-23f;
            add_dahl(&mix, 0.1, ldexpf(mantissa, (int)(motion_random(&m) % exponents) - 58));
        }
        TEST_ASSERT_TRUE(run(&mix, motion_walk, 20) <= DAHL_ULP_COUNTS);
        (void)dahl_parallel_step_counts(mix.part, mix.count, INT32_MIN); /* all at Fc, where a state errs by 2^-31 at most */
        for (uint32_t k = 0; k < mix.count; k++) {
            TEST_ASSERT_TRUE(mix.state[k].w <= ((int64_t)1 << 31) - ((int64_t)1 << 62));
        }
        TEST_ASSERT_TRUE(fabsl(dahl_parallel_step_counts(mix.part, mix.count, 0) + mix.sum) <= 0.508L * ulp_of_sum(mix.sum));
        check_ends_q30(&mix);
    }
}

/* The sum of many parts fits. */
static void test_a_hundred_parts(void)
{
    static dahl_part_t parts[100];
    dahl_state_t state = {0}; /* of all of them */
    const dahl_params_t params = {1e3f, 0x1.fffffep0f, 3.8e-4f};
    static dahl_plan_t plan;
    TEST_ASSERT_EQUAL_INT(DAHL_OK, dahl_prepare(&plan, &params));
    for (int k = 0; k < 100; k++) {
        const dahl_part_t part = DAHL_PART(&plan, &state);
        parts[k] = part;
    }
    TEST_ASSERT_TRUE(dahl_parallel_step_counts(parts, 100, INT32_MAX) == 100 * 0x1.fffffep0f);
    TEST_ASSERT_TRUE(dahl_parallel_step_counts(parts, 100, INT32_MIN) == -100 * 0x1.fffffep0f);
    static int32_t shares[100];
    dahl_parallel_shares(shares, parts, 100);
    TEST_ASSERT_EQUAL_INT32(-(1 << 30), dahl_parallel_step_counts_q30(parts, shares, 100, 0));
}

/* Parts move as they do alone, and small torques keep their relative accuracy. */
static void test_parts_move_as_alone(void)
{
    make(&mix, 2);
    dahl_state_t alone = {0};
    dahl_slip_state_t slip_alone = {{0}};
    motion_t m = MOTION_START;
    for (int t = 0; t < 1000; t++) {
        int32_t d = motion_walk(&m);
        (void)dahl_parallel_step_counts(mix.part, mix.count, d);
        (void)dahl_step_counts(&mix.plan[0], &alone, d);
        (void)dahl_slip_step_counts(&mix.slip_plan, &slip_alone, d);
        TEST_ASSERT_TRUE(mix.state[0].w == alone.w);
        TEST_ASSERT_EQUAL_MEMORY(&slip_alone, &mix.slip_state, sizeof slip_alone);
    }
}

static void test_tiny_motion(void)
{
    make(&mix, 4);
    for (int n = 1; n <= 1000; n++) {
        int32_t d = (n / 9) % 2 ? -1 : 1;
        long double F = exact_torque(&mix, d), error = fabsl(dahl_parallel_step_counts(mix.part, mix.count, d) - F);
        TEST_ASSERT_TRUE(fabsl(F) <= 1e-12L * mix.sum || error <= 1e-6L * fabsl(F));
    }
    make(&mix, 0);
    for (int bits = 28; bits < 61; bits++) {
        mix.state[0].w = mix.state[1].w = (int64_t)3 << bits;
        long double F = mix.sum * ldexpl(3, bits - 62);
        TEST_ASSERT_TRUE(fabsl(dahl_parallel_step_counts(mix.part, mix.count, 0) - F) <= 1e-6L * F);
    }
}

/* The opposite motion has the opposite torque, bit for bit, where the parts have: slip elements do. */
static void test_odd_symmetry(void)
{
    make(&mix, 2);
    dahl_slip_state_t opposite = {{0}};
    const dahl_part_t mirrored = DAHL_SLIP_PART(&mix.slip_plan, &opposite);
    for (size_t i = 0; i < MOTIONS; i++) {
        motion_t m = MOTION_START;
        for (int t = 0; t < 2000; t++) {
            int32_t d = motions[i].next(&m);
            d = d == INT32_MIN ? -INT32_MAX : d;
            TEST_ASSERT_TRUE(dahl_parallel_step_counts(&mix.part[1], 1, d) == -dahl_parallel_step_counts(&mirrored, 1, -d));
        }
    }
}

/* Plans of zeros add nothing and take no bit of the others', wherever they stand. */
static void test_plans_of_zeros(void)
{
    static const dahl_plan_t zero;
    static const dahl_slip_plan_t zero_slip;
    dahl_state_t none = {0}, other = {0};
    dahl_slip_state_t slip_none = {{0}};
    make(&mix, 0);
    const dahl_part_t parts[] = {DAHL_PART(&zero, &none), DAHL_PART(&mix.plan[0], &other), DAHL_SLIP_PART(&zero_slip, &slip_none)};
    motion_t m = MOTION_START;
    for (int t = 0; t < 1000; t++) {
        int32_t d = motion_walk(&m);
        TEST_ASSERT_TRUE(dahl_parallel_step_counts(parts, 3, d) == dahl_parallel_step_counts(mix.part, 1, d));
        TEST_ASSERT_TRUE(dahl_parallel_step_counts(parts, 1, d) == 0.0f);
        TEST_ASSERT_TRUE(dahl_parallel_step_counts(parts, 0, d) == 0.0f);
    }
    TEST_ASSERT_TRUE(none.w == 0 && slip_none.x[0] == 0);
}

/* In Q30 too: one element between plans of zeros is that element, and shares that nobody prepared give 0. */
static void test_plans_of_zeros_q30(void)
{
    static const dahl_plan_t zero;
    static const dahl_slip_plan_t zero_slip;
    static const int32_t unprepared[3];
    dahl_state_t none = {0}, ours = {0}, alone = {0};
    dahl_slip_state_t slip_none = {{0}};
    int32_t shares[3], no_share = 1;
    mix.count = 0;
    add_dahl(&mix, 1e-3, 0x1.5p-50f); /* its exponent is below that of a plan of zeros */
    const dahl_part_t parts[] = {DAHL_PART(&zero, &none), DAHL_PART(&mix.plan[0], &ours), DAHL_SLIP_PART(&zero_slip, &slip_none)};
    dahl_parallel_shares(shares, parts, 3);
    dahl_parallel_shares(&no_share, &parts[2], 1);
    TEST_ASSERT_EQUAL_INT32(0, no_share);
    motion_t m = MOTION_START;
    for (int t = 0; t < 1000; t++) {
        int32_t d = motion_walk(&m);
        TEST_ASSERT_EQUAL_INT32(dahl_step_counts_q30(&mix.plan[0], &alone, d), dahl_parallel_step_counts_q30(parts, shares, 3, d));
        TEST_ASSERT_EQUAL_INT32(0, dahl_parallel_step_counts_q30(parts, unprepared, 3, 0));
        TEST_ASSERT_EQUAL_INT32(0, dahl_parallel_step_counts_q30(parts, shares, 0, d));
    }
}

/* The sum is rounded to nearest, a half up: the mean of two elements of one Fc. */
static void test_two_of_one_Fc_have_their_mean(void)
{
    int32_t shares[2];
    dahl_state_t first = {0}, second = {0};
    mix.count = 0;
    add_dahl(&mix, 1e-3, 2.739f);
    add_dahl(&mix, 0.02, 2.739f);
    dahl_parallel_shares(shares, mix.part, 2);
    motion_t m = MOTION_START;
    for (int t = 0; t < 1000; t++) {
        int32_t d = motion_walk(&m);
        int64_t twice = (int64_t)dahl_step_counts_q30(&mix.plan[0], &first, d) + dahl_step_counts_q30(&mix.plan[1], &second, d);
        int64_t above = twice + 1; /* a floor() of picolibc on RV32 misses by 32 here */
        TEST_ASSERT_TRUE(2 * (int64_t)dahl_parallel_step_counts_q30(mix.part, shares, 2, d) == above - (above & 1));
    }
}

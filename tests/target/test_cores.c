/* SPDX-License-Identifier: MIT */
/* The ticks in assembly return the bits of the C, which CMakeLists.txt compiles under other names. Plans, states and moves are
 * random, with many ties, ends of ranges, states out of range, small torques and plans of zeros. */
#include "dahl_parts.h"

#include <string.h>
#include <unity.h>

#include "../random.h"

int32_t plain_step_counts_q30(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts);
float plain_step_counts(const dahl_plan_t *plan, dahl_state_t *state, int32_t dcounts);
int32_t plain_work_step_counts_q30(const dahl_plan_t *plan, dahl_state_t *state, dahl_work_t *work, int32_t dcounts);
float plain_work_step_counts(const dahl_plan_t *plan, dahl_state_t *state, dahl_work_t *work, int32_t dcounts);
float plain_step(const dahl_plan_t *plan, dahl_state_t *state, float dtheta);
float plain_torque(const dahl_plan_t *plan, const dahl_state_t *state);
int64_t plain_part_move(const void *plan, void *state, int32_t dcounts);
int32_t plain_parallel_step_counts_q30(const dahl_part_t *parts, const int32_t *shares, uint32_t count, int32_t dcounts);

#define TRIALS 300000u
#ifndef TICKS /* by counts and by angle; --full: 1e7 */
#define TICKS TRIALS
#endif
#define MOVES_PER_PLAN 60

static uint64_t seed;

void setUp(void)
{
    seed = 1;
}

static uint64_t random64(void)
{
    const uint64_t high = random_u32(&seed);
    return high << 32 | random_u32(&seed);
}

static uint32_t random_word(void)
{
    static const uint32_t ends[] = {0u, 1u, 0xffffu, 0x10000u, 0x7fffffffu, 0x80000000u, 0xffff0000u, 0xffffffffu};
    uint64_t bits = random64();
    return bits & 7u ? (uint32_t)(bits >> 32) : ends[bits >> 8 & 7u];
}

/* Mostly near that of 1 rad, else any that dahl_prepare writes (lib/model/kernel.h: DAHL_FAR). */
static int32_t random_a_exponent(void)
{
    const uint64_t bits = random64();
    const int32_t exponent = bits & 3u ? (int32_t)(bits >> 8 & 31u) - 40 : (int32_t)(bits >> 8 & 255u) - 159;
    const int is_far = exponent < -152 || exponent > 30;
    return is_far ? exponent - 0x600000 : exponent;
}

static dahl_plan_t random_plan(void)
{
    dahl_plan_t plan;
    memset(&plan, 0, sizeof plan);
    if (random64() % 16u == 0) {
        return plan;
    }
    plan.a_mantissa = random_word() | 0x80000000u;
    plan.a_exponent = random_a_exponent();
    plan.Fc_mantissa = random_word() | 0x80000000u;
    plan.Fc_exponent = (int32_t)(random64() % 128u) - 64 - 31;
    for (size_t k = 1; k < sizeof plan.g / sizeof plan.g[0]; k++) {
        plan.g[k].hi = random_word();
        plan.g[k].lo = random_word();
    }
    return plan;
}

/* -2^62 .. 2^62, a tie, a small torque, within a few units of an end or of the range, beyond an end, or any 64 bits. */
static int64_t random_w(void)
{
    const int64_t one = (int64_t)1 << 62, past = (int64_t)1 << 31, any = (int64_t)(random64() >> 1) - one;
    const uint64_t bits = random64();
    const int64_t near = (int64_t)(bits >> 8 & 7u) - 3;
    const int64_t tie = (int64_t)(((uint64_t)any & ~(uint64_t)UINT32_MAX) | 0x80000000u);
    const int64_t kinds[] = {any, any, tie, any >> (bits >> 8 & 63u), one + near, one + past + near, one + (int64_t)(bits >> 33),
                             (int64_t)(random64() | 1u)};
    const int64_t w = kinds[bits & 7u];
    return bits & 8u ? w : -w;
}

static int32_t random_move(void)
{
    uint64_t bits = random64();
    return bits & 31u ? (int32_t)(bits >> 8 & 31u) - 15 : (int32_t)(bits >> 32);
}

/* Mostly of a travel between 2^-12 and 2^12 if the plan is not far, else any bits; often with a short mantissa. */
static float random_angle(const dahl_plan_t *plan)
{
    const uint64_t random = random64();
    const int32_t exponent = 94 - plan->a_exponent + (int32_t)(random % 24u) - 12;
    uint32_t bits = (uint32_t)(random >> 32);
    float angle;
    if ((random >> 8 & 3u) != 0 && exponent >= 0 && exponent < 256) {
        bits = (bits & 0x807fffffu) | (uint32_t)exponent << 23;
    }
    switch (random >> 10 & 15u) {
    case 0:
        bits &= 0xffff0000u;
        break;
    case 1:
        bits |= 0x007ffff0u;
        break;
    case 2:
        bits = (bits & 0x80000000u) | (bits & 1u ? 0x7f800000u : 0); /* infinity or zero */
        break;
    default:
        break;
    }
    memcpy(&angle, &bits, sizeof angle);
    return angle;
}

static uint32_t bits_of(float x)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static void check_ticks(const dahl_plan_t *plan, dahl_state_t start, int32_t move)
{
    dahl_state_t ours = start, ours_q30 = start, plain = start, plain_q30 = start, part = start, plain_moved = start;
    TEST_ASSERT_EQUAL_HEX32(bits_of(plain_torque(plan, &start)), bits_of(dahl_torque(plan, &start)));
    TEST_ASSERT_EQUAL_HEX32(plain_step_counts_q30(plan, &plain_q30, move), dahl_step_counts_q30(plan, &ours_q30, move));
    TEST_ASSERT_EQUAL_HEX32(bits_of(plain_step_counts(plan, &plain, move)), bits_of(dahl_step_counts(plan, &ours, move)));
    TEST_ASSERT_TRUE(plain_part_move(plan, &plain_moved, move) == dahl_part_move(plan, &part, move) && plain_moved.w == part.w);
    TEST_ASSERT_TRUE(plain_q30.w == ours_q30.w && plain.w == ours.w); /* Unity has no 64 bits here */
}

static void check_angle(const dahl_plan_t *plan, dahl_state_t start, int32_t move)
{
    const float angle = random_angle(plan);
    dahl_state_t ours = start, plain = start;
    (void)move;
    TEST_ASSERT_EQUAL_HEX32(bits_of(plain_step(plan, &plain, angle)), bits_of(dahl_step(plan, &ours, angle)));
    TEST_ASSERT_TRUE(plain.w == ours.w);
}

/* Sums that often carry through several words with the next move. */
static dahl_work_t random_work(void)
{
    dahl_work_t work;
    for (size_t i = 0; i < 3; i++) {
        work.counts[i] = random64() % 4u ? random_word() : UINT32_MAX;
    }
    for (size_t i = 0; i < 4; i++) {
        work.way[i] = random64() % 4u ? random_word() : UINT32_MAX;
    }
    return work;
}

static void check_work(const dahl_plan_t *plan, dahl_state_t start, int32_t move)
{
    const dahl_work_t before = random_work();
    dahl_state_t ours = start, ours_q30 = start, plain = start, plain_q30 = start;
    dahl_work_t work = before, work_q30 = before, sums = before, sums_q30 = before;
    TEST_ASSERT_EQUAL_HEX32(plain_work_step_counts_q30(plan, &plain_q30, &sums_q30, move),
                            dahl_work_step_counts_q30(plan, &ours_q30, &work_q30, move));
    TEST_ASSERT_EQUAL_HEX32(bits_of(plain_work_step_counts(plan, &plain, &sums, move)),
                            bits_of(dahl_work_step_counts(plan, &ours, &work, move)));
    TEST_ASSERT_TRUE(plain_q30.w == ours_q30.w && plain.w == ours.w);
    TEST_ASSERT_EQUAL_MEMORY(&sums, &work, sizeof sums);
    TEST_ASSERT_EQUAL_MEMORY(&sums_q30, &work_q30, sizeof sums);
}

#define PARTS 3

/* 0 to 3 Dahl elements on one plan. One of them may have another function, as other parts have. */
static void check_parallel(const dahl_plan_t *plan, dahl_state_t start, int32_t move)
{
    dahl_state_t ours[PARTS], plain[PARTS];
    dahl_part_t by_ours[PARTS], by_plain[PARTS];
    int32_t shares[PARTS];
    for (size_t k = 0; k < PARTS; k++) {
        const dahl_part_t part = DAHL_PART(plan, &ours[k]);
        by_ours[k] = by_plain[k] = part;
        by_plain[k].state = &plain[k];
        ours[k].w = plain[k].w = k == 0 ? start.w : random_w();
        shares[k] = (int32_t)(0u - (random_word() >> 1) / PARTS);
    }
    const uint32_t count = (uint32_t)(random64() % (PARTS + 1));
    by_ours[random64() % PARTS].move = random64() % 4u == 0 ? plain_part_move : dahl_part_move;
    TEST_ASSERT_EQUAL_HEX32(plain_parallel_step_counts_q30(by_plain, shares, count, move),
                            dahl_parallel_step_counts_q30(by_ours, shares, count, move));
    for (size_t k = 0; k < PARTS; k++) {
        TEST_ASSERT_TRUE(plain[k].w == ours[k].w);
    }
}

static void on_random_plans(uint32_t trials, void (*check)(const dahl_plan_t *plan, dahl_state_t start, int32_t move))
{
    dahl_plan_t plan = random_plan();
    for (uint32_t trial = 0; trial < trials; trial++) {
        if (trial % MOVES_PER_PLAN == 0) {
            plan = random_plan();
        }
        const dahl_state_t start = {random_w()};
        check(&plan, start, random_move());
    }
}

static void test_ticks_of_this_core_have_the_bits_of_the_c(void)
{
    on_random_plans(TICKS, check_ticks);
}

static void test_the_tick_by_angle_has_the_bits_of_the_c(void)
{
    on_random_plans(TICKS, check_angle);
}

static void test_ticks_with_work_have_the_bits_of_the_c(void)
{
    on_random_plans(TRIALS, check_work);
}

static void test_parts_in_parallel_have_the_bits_of_the_c(void)
{
    on_random_plans(TRIALS, check_parallel);
}

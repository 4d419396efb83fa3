/* SPDX-License-Identifier: MIT */
/* The laws of the element's fuzzer over random plans, states, moves, torques that are set and plans that change: each step is Eq. 1
 * solved, the state stays in range, a torque is read back, a change keeps F or the deflection and never stores more energy. */
#include <unity.h>

#define LAW(condition, words) TEST_ASSERT_TRUE_MESSAGE(condition, words)
#include "../fuzz/step.c"

#ifndef TEST_TICKS
#define TEST_TICKS 200000
#endif

static void test_the_laws_of_the_fuzzer_hold_for_random_input(void)
{
    fuzz_at_random(TEST_TICKS, 64);
}

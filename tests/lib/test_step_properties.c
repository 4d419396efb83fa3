/* SPDX-License-Identifier: MIT */
/* The properties of the step fuzzer, checked with random input: each step solves Eq. 1, the state stays in range, torques are read
 * back, and a change of the plan keeps F or the deflection. */
#include <unity.h>

#include "../fuzz/step.c"

#ifndef TEST_TICKS
#define TEST_TICKS 200000
#endif

static void test_the_laws_of_a_step_hold_for_random_input(void)
{
    fuzz_at_random(TEST_TICKS, 64);
}

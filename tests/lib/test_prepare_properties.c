/* SPDX-License-Identifier: MIT */
/* The properties of the fuzzer of plans, checked with random input: parameters are accepted if and only if they are in range, a
 * refusal leaves the plan unchanged, and the entries of a plan are 1 - exp(-u). */
#include <unity.h>

#include "../fuzz/prepare.c"

#ifndef TEST_TICKS
#define TEST_TICKS 200000
#endif

static void test_the_laws_of_plans_hold_for_random_parameters(void)
{
    fuzz_at_random(TEST_TICKS / 4, 256);
}

/* SPDX-License-Identifier: MIT */
/* The laws of the fuzzer of parts, checked with random input: the contract of each model from rest, return-point memory, no
 * creep below breakaway, the integral of the work, the inverse, tips, and loads of 1. */
#include <unity.h>

#define LAW(condition, words) TEST_ASSERT_TRUE_MESSAGE(condition, words)
#include "../fuzz/parts.c"

#ifndef TEST_TICKS
#define TEST_TICKS 200000
#endif

static void test_the_laws_of_parts_hold_for_random_input(void)
{
    fuzz_at_random(TEST_TICKS / 10, 128);
}

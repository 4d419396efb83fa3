/* SPDX-License-Identifier: MIT */
/* The laws of the node's fuzzer over random frames at random times: each frame has one fate, the bristle moves only with an answer
 * and as the library moves it, silence ends only with enough good frames in a row, a twin on another clock says the same. */
#include <unity.h>

#define LAW(condition, words) TEST_ASSERT_TRUE_MESSAGE(condition, words)
#include "../fuzz/receiver.c"

static void test_the_laws_of_the_fuzzer_hold_for_random_frames(void)
{
    fuzz_at_random(20000, 300);
}

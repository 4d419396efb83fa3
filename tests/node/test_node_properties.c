/* SPDX-License-Identifier: MIT */
/* The properties of the node's fuzzer for random frames at random times. Each frame increases one count, the bristle moves only with
 * an answer, and a timeout ends only after enough good frames. */
#include <unity.h>

#include "../fuzz/receiver.c"

static void test_the_laws_of_the_node_hold_for_random_frames(void)
{
    fuzz_at_random(20000, 300);
}

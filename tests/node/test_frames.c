/* SPDX-License-Identifier: MIT */
/* The codec: the properties of its fuzzer for random frames and values. tests/python compares the bits with dahl.dbc and
 * autosar-e2e. */
#include <string.h>
#include <unity.h>

#include "../fuzz/codec.c"

static void test_the_laws_of_the_codec_hold_for_random_input(void)
{
    fuzz_at_random(300000, 24);
}

/* Later versions may use them. */
static void test_unused_bits_are_0_and_ignored_and_node_numbers_have_4_bits(void)
{
    dahl_encoder_state_t seen;
    dahl_can_frame_t frame;
    memset(&frame, 0xA5, sizeof frame);
    dahl_frames_pack_encoder(&frame, 0xF2, &(dahl_encoder_state_t){.count = -77, .counter = 9, .valid = false});
    TEST_ASSERT_EQUAL_HEX32(0x102, frame.id);
    TEST_ASSERT_TRUE(frame.flags == 0 && frame.length == 8 && frame.time_us == 0);
    TEST_ASSERT_TRUE(frame.data[1] == 9 && frame.data[6] == 0 && frame.data[7] == 0);
    frame.data[1] |= 0xE0;
    frame.data[6] = frame.data[7] = 0xFF;
    frame.data[0] = dahl_frames_crc(frame.data, DAHL_FRAMES_KIND_ENCODER);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_GOOD, dahl_frames_unpack_encoder(&frame, &seen));
    TEST_ASSERT_TRUE(seen.count == -77 && seen.counter == 9 && !seen.valid);
}

/* SPDX-License-Identifier: MIT */
/* The codec: the laws of its fuzzer for random frames and values, and what the CRC detects. tests/python compares the bits with
 * dahl.dbc and autosar-e2e. */
#include <string.h>
#include <unity.h>

#define LAW(condition, words) TEST_ASSERT_TRUE_MESSAGE(condition, words)
#include "../fuzz/codec.c"

static void test_the_laws_of_the_codec_hold_for_random_input(void)
{
    fuzz_at_random(300000, 24);
}

static void flip(dahl_can_frame_t *frame, uint32_t bit)
{
    frame->data[bit / 8] = (uint8_t)(frame->data[bit / 8] ^ (1u << (bit % 8)));
}

/* Whether the frame is accepted although three bits are flipped. */
static bool passes(const dahl_can_frame_t *good, uint32_t a, uint32_t b, uint32_t c)
{
    dahl_can_frame_t frame = *good;
    dahl_encoder_state_t out;
    flip(&frame, a);
    flip(&frame, b);
    flip(&frame, c);
    return dahl_frames_unpack_encoder(&frame, &out) == DAHL_FRAMES_GOOD;
}

/* The CRC detects each single and double bit error. Of 41,664 triples it misses 48, all with bits of the counter
 * (dahl_frames.h). */
static void test_the_crc_detects_the_documented_bit_errors(void)
{
    dahl_can_frame_t frame;
    uint32_t triples = 0, missed = 0;
    dahl_frames_pack_encoder(&frame, 0, &(dahl_encoder_state_t){.count = 0x12345678, .counter = 9, .valid = true});
    for (uint32_t a = 0; a < 64; a++) {
        TEST_ASSERT_FALSE(passes(&frame, a, 0, 0)); /* the flips of bit 0 cancel */
        for (uint32_t b = a + 1; b < 64; b++) {
            TEST_ASSERT_FALSE(passes(&frame, a, b, b) || passes(&frame, a, b, a));
            for (uint32_t c = b + 1; c < 64; c++) {
                bool has_counter = (8 <= a && a < 12) || (8 <= b && b < 12) || (8 <= c && c < 12), passed = passes(&frame, a, b, c);
                TEST_ASSERT_TRUE(!passed || has_counter);
                triples++;
                missed += passed ? 1u : 0u;
            }
        }
    }
    TEST_ASSERT_EQUAL_UINT32(41664, triples);
    TEST_ASSERT_EQUAL_UINT32(48, missed);
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

/* SPDX-License-Identifier: MIT */
/* The codec against a CRC written from its definition, and against every small corruption. */
#include <string.h>
#include <unity.h>

#include "dahl_frames.h"
#include "random.h"

enum { ROUNDS = 20000 };

void setUp(void)
{
}

void tearDown(void)
{
}

/* Polynomial division, bit by bit: shares nothing with the table of frames.c. */
static uint8_t reference_crc(const uint8_t *bytes, size_t count)
{
    uint32_t rest = 0xFF;
    for (size_t i = 0; i < count; i++) {
        for (int bit = 7; bit >= 0; bit--) {
            uint32_t in = (bytes[i] >> bit) & 1u;
            uint32_t out = (rest >> 7) & 1u;
            rest = ((rest << 1) & 0xFFu) ^ ((in ^ out) != 0 ? 0x2Fu : 0u);
        }
    }
    return (uint8_t)(rest ^ 0xFFu);
}

/* Test values that AUTOSAR's "Specification of CRC Routines" gives for CRC8H2F. */
static void test_reference_gives_the_values_of_autosar(void)
{
    const uint8_t zeros[] = {0, 0, 0, 0};
    const uint8_t second[] = {0xF2, 0x01, 0x83};
    const uint8_t third[] = {0x0F, 0xAA, 0x00, 0x55};
    const uint8_t ones[] = {0xFF, 0xFF, 0xFF, 0xFF};
    const uint8_t text[] = "123456789";
    TEST_ASSERT_EQUAL_HEX8(0x12, reference_crc(zeros, 4));
    TEST_ASSERT_EQUAL_HEX8(0xC2, reference_crc(second, 3));
    TEST_ASSERT_EQUAL_HEX8(0xC6, reference_crc(third, 4));
    TEST_ASSERT_EQUAL_HEX8(0x6C, reference_crc(ones, 4));
    TEST_ASSERT_EQUAL_HEX8(0xDF, reference_crc(text, 9));
}

static void test_crc_is_the_reference_over_bytes_and_data_id(void)
{
    uint64_t seed = 1;
    for (int i = 0; i < ROUNDS; i++) {
        uint8_t data[9];
        for (size_t k = 0; k < 8; k++) {
            data[k] = (uint8_t)random_u32(&seed);
        }
        uint8_t kind = (uint8_t)(random_u32(&seed) & 0x0F);
        data[8] = (uint8_t)((kind << 4) | (data[1] & 0x0F));
        TEST_ASSERT_EQUAL_HEX8(reference_crc(data + 1, 8), frames_crc(data, kind));
    }
}

static void test_encoder_state_comes_back(void)
{
    uint64_t seed = 2;
    for (int i = 0; i < ROUNDS; i++) {
        encoder_state_t in = {(int32_t)random_u32(&seed), random_u32(&seed) & 0x0F, (random_u32(&seed) & 1u) != 0};
        encoder_state_t out;
        can_frame_t frame;
        frames_pack_encoder(&frame, 5, &in);
        TEST_ASSERT_EQUAL_HEX32(0x105, frame.id);
        TEST_ASSERT_EQUAL(8, frame.length);
        TEST_ASSERT_EQUAL(FRAMES_GOOD, frames_unpack_encoder(&frame, &out));
        TEST_ASSERT_EQUAL(in.count, out.count);
        TEST_ASSERT_EQUAL(in.counter, out.counter);
        TEST_ASSERT_EQUAL(in.valid, out.valid);
    }
}

static void test_friction_torque_comes_back(void)
{
    uint64_t seed = 3;
    for (int i = 0; i < ROUNDS; i++) {
        friction_torque_t in = {(int32_t)random_u32(&seed), random_u32(&seed) & 0x0F, random_u32(&seed) & 0x0F,
                                random_u32(&seed) & 0x0F};
        friction_torque_t out;
        can_frame_t frame;
        frames_pack_torque(&frame, 15, &in);
        TEST_ASSERT_EQUAL_HEX32(0x11F, frame.id);
        TEST_ASSERT_EQUAL(FRAMES_GOOD, frames_unpack_torque(&frame, &out));
        TEST_ASSERT_EQUAL(in.torque_q30, out.torque_q30);
        TEST_ASSERT_EQUAL(in.counter, out.counter);
        TEST_ASSERT_EQUAL(in.state, out.state);
        TEST_ASSERT_EQUAL(in.echo, out.echo);
    }
}

static void test_status_comes_back(void)
{
    uint64_t seed = 4;
    for (int i = 0; i < ROUNDS; i++) {
        node_status_t in = {
            .counter = random_u32(&seed) & 0x0F,
            .state = random_u32(&seed) & 0x0F,
            .errors = (uint8_t)random_u32(&seed),
            .lost = (uint8_t)random_u32(&seed),
            .corrupt = (uint8_t)random_u32(&seed),
            .out_of_step = (uint8_t)random_u32(&seed),
            .version_major = random_u32(&seed) & 0x0F,
            .version_minor = random_u32(&seed) & 0x0F,
        };
        node_status_t out;
        can_frame_t frame;
        memset(&out, 0xA5, sizeof out);
        frames_pack_status(&frame, 0, &in);
        TEST_ASSERT_EQUAL_HEX32(0x120, frame.id);
        TEST_ASSERT_EQUAL(FRAMES_GOOD, frames_unpack_status(&frame, &out));
        TEST_ASSERT_EQUAL_MEMORY(&in, &out, sizeof in);
    }
}

static void test_param_write_comes_back(void)
{
    uint64_t seed = 10;
    for (int i = 0; i < ROUNDS; i++) {
        param_write_t in = {random_u32(&seed), random_u32(&seed) & 0x0F, (uint8_t)random_u32(&seed), (random_u32(&seed) & 1u) != 0};
        param_write_t out = {.value = ~in.value, .write = !in.write};
        can_frame_t frame;
        frames_pack_param_write(&frame, 9, &in);
        TEST_ASSERT_EQUAL_HEX32(0x139, frame.id);
        TEST_ASSERT_EQUAL(FRAMES_GOOD, frames_unpack_param_write(&frame, &out));
        TEST_ASSERT_EQUAL_HEX32(in.value, out.value);
        TEST_ASSERT_EQUAL(in.counter, out.counter);
        TEST_ASSERT_EQUAL(in.param, out.param);
        TEST_ASSERT_EQUAL(in.write, out.write);
    }
}

static void test_param_reply_comes_back(void)
{
    uint64_t seed = 11;
    for (int i = 0; i < ROUNDS; i++) {
        param_reply_t in = {random_u32(&seed), random_u32(&seed) & 0x0F, (uint8_t)random_u32(&seed), random_u32(&seed) & 0x0F};
        param_reply_t out = {.value = ~in.value};
        can_frame_t frame;
        frames_pack_param_reply(&frame, 1, &in);
        TEST_ASSERT_EQUAL_HEX32(0x141, frame.id);
        TEST_ASSERT_EQUAL(FRAMES_GOOD, frames_unpack_param_reply(&frame, &out));
        TEST_ASSERT_EQUAL_HEX32(in.value, out.value);
        TEST_ASSERT_EQUAL(in.counter, out.counter);
        TEST_ASSERT_EQUAL(in.param, out.param);
        TEST_ASSERT_EQUAL(in.result, out.result);
    }
}

static void test_reset_comes_back(void)
{
    for (uint32_t i = 0; i < 256; i++) {
        node_reset_t in = {.counter = i & 0x0F, .what = (uint8_t)(i >> 4)};
        node_reset_t out = {0xA5, 0xA5};
        can_frame_t frame;
        frames_pack_reset(&frame, 2, &in);
        TEST_ASSERT_EQUAL_HEX32(0x152, frame.id);
        TEST_ASSERT_EQUAL(FRAMES_GOOD, frames_unpack_reset(&frame, &out));
        TEST_ASSERT_EQUAL(in.counter, out.counter);
        TEST_ASSERT_EQUAL(in.what, out.what);
    }
}

/* All bytes of a frame are written: none is left from what the memory held before. Node numbers are cut to 4 bits. */
static void test_packing_writes_every_byte(void)
{
    can_frame_t frame;
    memset(&frame, 0xA5, sizeof frame);
    frames_pack_reset(&frame, 0xF2, &(node_reset_t){.what = FRAMES_RESET_RESTART, .counter = 3});
    TEST_ASSERT_EQUAL_HEX32(0x152, frame.id);
    TEST_ASSERT_EQUAL(0, frame.flags);
    TEST_ASSERT_EQUAL(8, frame.length);
    TEST_ASSERT_TRUE(frame.time_us == 0);
    TEST_ASSERT_EQUAL_HEX8(0x23, frame.data[1]);
    for (size_t i = 2; i < 8; i++) {
        TEST_ASSERT_EQUAL_HEX8(0, frame.data[i]);
    }
    memset(&frame, 0xA5, sizeof frame);
    frames_pack_torque(&frame, 1, &(friction_torque_t){.torque_q30 = -1, .counter = 4, .state = FRAMES_LOST, .echo = 7});
    TEST_ASSERT_EQUAL_HEX8(0x24, frame.data[1]);
    TEST_ASSERT_EQUAL_HEX8(0x07, frame.data[2]);
    TEST_ASSERT_EQUAL_HEX8(0, frame.data[3]);
    memset(&frame, 0xA5, sizeof frame);
    frames_pack_param_write(&frame, 1, &(param_write_t){.value = UINT32_MAX, .counter = 4, .param = 8, .write = true});
    TEST_ASSERT_EQUAL_HEX8(0x14, frame.data[1]);
    TEST_ASSERT_EQUAL_HEX8(0x08, frame.data[2]);
    TEST_ASSERT_EQUAL_HEX8(0, frame.data[3]);
    memset(&frame, 0xA5, sizeof frame);
    frames_pack_encoder(&frame, 1, &(encoder_state_t){.count = -1, .counter = 4, .valid = true});
    TEST_ASSERT_EQUAL_HEX8(0x14, frame.data[1]);
    TEST_ASSERT_EQUAL_HEX8(0, frame.data[6]);
    TEST_ASSERT_EQUAL_HEX8(0, frame.data[7]);
}

/* Later versions may use them: whatever stands there, an older node reads the rest. */
static void test_unused_bits_of_an_encoder_state_mean_nothing(void)
{
    encoder_state_t in = {-77, 9, false};
    encoder_state_t out;
    can_frame_t frame;
    frames_pack_encoder(&frame, 0, &in);
    frame.data[1] |= 0xE0;
    frame.data[6] = 0xFF;
    frame.data[7] = 0xFF;
    frame.data[0] = frames_crc(frame.data, FRAMES_KIND_ENCODER);
    TEST_ASSERT_EQUAL(FRAMES_GOOD, frames_unpack_encoder(&frame, &out));
    TEST_ASSERT_EQUAL(-77, out.count);
    TEST_ASSERT_EQUAL(9, out.counter);
    TEST_ASSERT_FALSE(out.valid);
}

static can_frame_t sample(uint64_t *seed)
{
    encoder_state_t in = {(int32_t)random_u32(seed), random_u32(seed) & 0x0F, true};
    can_frame_t frame;
    frames_pack_encoder(&frame, 0, &in);
    return frame;
}

static void flip(can_frame_t *frame, uint32_t bit)
{
    frame->data[bit / 8] = (uint8_t)(frame->data[bit / 8] ^ (1u << (bit % 8)));
}

static bool passes(const can_frame_t *frame)
{
    encoder_state_t out;
    return frames_unpack_encoder(frame, &out) == FRAMES_GOOD;
}

/* All 64 + 2016 + 41664 of them; flips of the counter change the data id as well. */
static void test_no_one_or_two_flipped_bits_pass(void)
{
    uint64_t seed = 5;
    can_frame_t frame = sample(&seed);
    for (uint32_t a = 0; a < 64; a++) {
        flip(&frame, a);
        TEST_ASSERT_FALSE(passes(&frame));
        for (uint32_t b = a + 1; b < 64; b++) {
            flip(&frame, b);
            TEST_ASSERT_FALSE(passes(&frame));
            flip(&frame, b);
        }
        flip(&frame, a);
    }
}

static uint32_t count_passing_triples(can_frame_t *frame, uint32_t first)
{
    uint32_t passing = 0;
    for (uint32_t a = first; a < 64; a++) {
        for (uint32_t b = a + 1; b < 64; b++) {
            for (uint32_t c = b + 1; c < 64; c++) {
                flip(frame, a);
                flip(frame, b);
                flip(frame, c);
                passing += passes(frame) ? 1u : 0u;
                flip(frame, a);
                flip(frame, b);
                flip(frame, c);
            }
        }
    }
    return passing;
}

static void test_no_three_flipped_bits_beside_the_counter_pass(void)
{
    uint64_t seed = 6;
    can_frame_t frame = sample(&seed);
    TEST_ASSERT_EQUAL(0, count_passing_triples(&frame, 12));
}

static void test_a_frame_of_one_kind_is_no_other(void)
{
    uint64_t seed = 7;
    friction_torque_t torque;
    node_status_t status;
    for (int i = 0; i < ROUNDS; i++) {
        can_frame_t frame = sample(&seed);
        TEST_ASSERT_EQUAL(FRAMES_BAD_CRC, frames_unpack_torque(&frame, &torque));
        TEST_ASSERT_EQUAL(FRAMES_BAD_CRC, frames_unpack_status(&frame, &status));
    }
}

static void test_a_bad_form_is_refused_before_anything_is_read(void)
{
    uint64_t seed = 8;
    const uint8_t flags[] = {CAN_FRAME_EXTENDED, CAN_FRAME_REMOTE, CAN_FRAME_ERROR, CAN_FRAME_FD};
    encoder_state_t untouched = {123456, 7, true};
    encoder_state_t out = untouched;
    for (uint8_t length = 0; length < 8; length++) {
        can_frame_t frame = sample(&seed);
        frame.length = length;
        TEST_ASSERT_EQUAL(FRAMES_BAD_FORMAT, frames_unpack_encoder(&frame, &out));
    }
    for (uint32_t length = 9; length < 256; length++) { /* what no classic frame has, but the field can say */
        can_frame_t frame = sample(&seed);
        frame.length = (uint8_t)length;
        TEST_ASSERT_EQUAL(FRAMES_BAD_FORMAT, frames_unpack_encoder(&frame, &out));
    }
    for (size_t i = 0; i < sizeof flags; i++) {
        can_frame_t frame = sample(&seed);
        frame.flags = flags[i];
        TEST_ASSERT_EQUAL(FRAMES_BAD_FORMAT, frames_unpack_encoder(&frame, &out));
    }
    TEST_ASSERT_EQUAL_MEMORY(&untouched.count, &out.count, sizeof out.count);
    TEST_ASSERT_EQUAL(untouched.counter, out.counter);
}

/* Of each kind: a frame of wrong CRC, and one of wrong length, leave what was there. */
#define ASSERT_UNTOUCHED(unpack, type)                            \
    do {                                                          \
        type out_, before_;                                       \
        memset(&out_, 0x5A, sizeof out_);                         \
        memcpy(&before_, &out_, sizeof out_);                     \
        TEST_ASSERT_EQUAL(FRAMES_BAD_CRC, unpack(&wrong, &out_)); \
        TEST_ASSERT_EQUAL(FRAMES_BAD_FORMAT, unpack(&shorter, &out_)); \
        TEST_ASSERT_EQUAL_MEMORY(&before_, &out_, sizeof out_);   \
    } while (0)

static void test_a_bad_frame_of_any_kind_touches_nothing(void)
{
    can_frame_t wrong = {.id = 0x100, .length = 8, .data = {0, 1, 2, 3, 4, 5, 6, 7}};
    can_frame_t shorter = wrong;
    shorter.length = 7;
    for (int kind = 0; kind < 16; kind++) { /* a CRC that is right for no kind */
        if (wrong.data[0] == frames_crc(wrong.data, (uint8_t)kind)) {
            wrong.data[0]++;
            kind = -1;
        }
    }
    ASSERT_UNTOUCHED(frames_unpack_encoder, encoder_state_t);
    ASSERT_UNTOUCHED(frames_unpack_torque, friction_torque_t);
    ASSERT_UNTOUCHED(frames_unpack_status, node_status_t);
    ASSERT_UNTOUCHED(frames_unpack_param_write, param_write_t);
    ASSERT_UNTOUCHED(frames_unpack_param_reply, param_reply_t);
    ASSERT_UNTOUCHED(frames_unpack_reset, node_reset_t);
}

static void test_reserved_bits_do_not_matter_to_a_receiver(void)
{
    uint64_t seed = 9;
    can_frame_t frame = sample(&seed);
    frame.data[7] = 0x5A;
    frame.data[1] |= 0xE0;
    frame.data[0] = frames_crc(frame.data, FRAMES_KIND_ENCODER);
    TEST_ASSERT_TRUE(passes(&frame));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_reference_gives_the_values_of_autosar);
    RUN_TEST(test_crc_is_the_reference_over_bytes_and_data_id);
    RUN_TEST(test_encoder_state_comes_back);
    RUN_TEST(test_unused_bits_of_an_encoder_state_mean_nothing);
    RUN_TEST(test_friction_torque_comes_back);
    RUN_TEST(test_status_comes_back);
    RUN_TEST(test_param_write_comes_back);
    RUN_TEST(test_param_reply_comes_back);
    RUN_TEST(test_reset_comes_back);
    RUN_TEST(test_packing_writes_every_byte);
    RUN_TEST(test_no_one_or_two_flipped_bits_pass);
    RUN_TEST(test_no_three_flipped_bits_beside_the_counter_pass);
    RUN_TEST(test_a_frame_of_one_kind_is_no_other);
    RUN_TEST(test_a_bad_form_is_refused_before_anything_is_read);
    RUN_TEST(test_a_bad_frame_of_any_kind_touches_nothing);
    RUN_TEST(test_reserved_bits_do_not_matter_to_a_receiver);
    return UNITY_END();
}

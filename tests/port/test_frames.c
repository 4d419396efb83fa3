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
        TEST_ASSERT_EQUAL_HEX8(reference_crc(data + 1, 8), dahl_frames_crc(data, kind));
    }
}

/* Of random values: each comes back from its frame, which has the id of its kind and node. */
#define ASSERT_COMES_BACK(kind, type, frame_id, ...)                                   \
    do {                                                                               \
        type in_ = __VA_ARGS__, out_;                                                  \
        dahl_can_frame_t frame_;                                                       \
        memset(&out_, 0xA5, sizeof out_);                                              \
        dahl_frames_pack_##kind(&frame_, frame_id & 15u, &in_);                        \
        TEST_ASSERT_EQUAL_HEX32(frame_id, frame_.id);                                  \
        TEST_ASSERT_EQUAL(8, frame_.length);                                           \
        TEST_ASSERT_EQUAL(DAHL_FRAMES_GOOD, dahl_frames_unpack_##kind(&frame_, &out_)); \
        TEST_ASSERT_TRUE_MESSAGE(is_same_##kind(&in_, &out_), #kind);                  \
    } while (0)

static bool is_same_encoder(const dahl_encoder_state_t *a, const dahl_encoder_state_t *b)
{
    return a->count == b->count && a->counter == b->counter && a->valid == b->valid;
}

static bool is_same_torque(const dahl_friction_torque_t *a, const dahl_friction_torque_t *b)
{
    return a->torque_q30 == b->torque_q30 && a->counter == b->counter && a->state == b->state && a->echo == b->echo;
}

static bool is_same_status(const dahl_node_status_t *a, const dahl_node_status_t *b)
{
    return memcmp(a, b, sizeof *a) == 0; /* bytes all */
}

static bool is_same_param_write(const dahl_param_write_t *a, const dahl_param_write_t *b)
{
    return a->value == b->value && a->counter == b->counter && a->param == b->param && a->write == b->write;
}

static bool is_same_param_reply(const dahl_param_reply_t *a, const dahl_param_reply_t *b)
{
    return a->value == b->value && a->counter == b->counter && a->param == b->param && a->result == b->result;
}

static bool is_same_reset(const dahl_node_reset_t *a, const dahl_node_reset_t *b)
{
    return a->counter == b->counter && a->what == b->what;
}

static void test_each_kind_comes_back(void)
{
    uint64_t seed = 2;
    for (int i = 0; i < ROUNDS; i++) {
        uint32_t word = random_u32(&seed), bits = random_u32(&seed);
        uint8_t a = bits & 15u, b = (bits >> 4) & 15u, c = (bits >> 8) & 15u, byte = (uint8_t)(bits >> 16);
        ASSERT_COMES_BACK(encoder, dahl_encoder_state_t, 0x105, {(int32_t)word, a, (b & 1u) != 0});
        ASSERT_COMES_BACK(torque, dahl_friction_torque_t, 0x11F, {(int32_t)word, a, b, c});
        ASSERT_COMES_BACK(status, dahl_node_status_t, 0x120,
                          {.counter = a, .state = b, .errors = byte, .lost = (uint8_t)word, .corrupt = (uint8_t)(word >> 8),
                           .out_of_step = (uint8_t)(word >> 16), .version_major = c, .version_minor = (word >> 24) & 15u,
                           .timeout = (uint8_t)(bits >> 24)});
        ASSERT_COMES_BACK(param_write, dahl_param_write_t, 0x139, {word, a, byte, b & 3u});
        ASSERT_COMES_BACK(param_reply, dahl_param_reply_t, 0x141, {word, a, byte, b});
        ASSERT_COMES_BACK(reset, dahl_node_reset_t, 0x152, {.counter = a, .what = b});
    }
}

/* All bytes of a frame are written: none is left from what the memory held before. Node numbers are cut to 4 bits. */
static void test_packing_writes_every_byte(void)
{
    dahl_can_frame_t frame;
    memset(&frame, 0xA5, sizeof frame);
    dahl_frames_pack_reset(&frame, 0xF2, &(dahl_node_reset_t){.what = DAHL_FRAMES_RESET_RESTART, .counter = 3});
    TEST_ASSERT_EQUAL_HEX32(0x152, frame.id);
    TEST_ASSERT_EQUAL(0, frame.flags);
    TEST_ASSERT_EQUAL(8, frame.length);
    TEST_ASSERT_TRUE(frame.time_us == 0);
    TEST_ASSERT_EQUAL_HEX8(0x23, frame.data[1]);
    for (size_t i = 2; i < 8; i++) {
        TEST_ASSERT_EQUAL_HEX8(0, frame.data[i]);
    }
    memset(&frame, 0xA5, sizeof frame);
    dahl_frames_pack_torque(&frame, 1, &(dahl_friction_torque_t){.torque_q30 = -1, .counter = 4, .state = DAHL_FRAMES_LOST, .echo = 7});
    TEST_ASSERT_EQUAL_HEX8(0x24, frame.data[1]);
    TEST_ASSERT_EQUAL_HEX8(0x07, frame.data[2]);
    TEST_ASSERT_EQUAL_HEX8(0, frame.data[3]);
    memset(&frame, 0xA5, sizeof frame);
    dahl_frames_pack_param_write(&frame, 1, &(dahl_param_write_t){.value = UINT32_MAX, .counter = 4, .param = 8, .write = true});
    TEST_ASSERT_EQUAL_HEX8(0x14, frame.data[1]);
    TEST_ASSERT_EQUAL_HEX8(0x08, frame.data[2]);
    TEST_ASSERT_EQUAL_HEX8(0, frame.data[3]);
    memset(&frame, 0xA5, sizeof frame);
    dahl_frames_pack_encoder(&frame, 1, &(dahl_encoder_state_t){.count = -1, .counter = 4, .valid = true});
    TEST_ASSERT_EQUAL_HEX8(0x14, frame.data[1]);
    TEST_ASSERT_EQUAL_HEX8(0, frame.data[6]);
    TEST_ASSERT_EQUAL_HEX8(0, frame.data[7]);
}

/* Later versions may use them: whatever stands there, an older node reads the rest. */
static void test_unused_bits_of_an_encoder_state_mean_nothing(void)
{
    dahl_encoder_state_t in = {-77, 9, false};
    dahl_encoder_state_t out;
    dahl_can_frame_t frame;
    dahl_frames_pack_encoder(&frame, 0, &in);
    frame.data[1] |= 0xE0;
    frame.data[6] = 0xFF;
    frame.data[7] = 0xFF;
    frame.data[0] = dahl_frames_crc(frame.data, DAHL_FRAMES_KIND_ENCODER);
    TEST_ASSERT_EQUAL(DAHL_FRAMES_GOOD, dahl_frames_unpack_encoder(&frame, &out));
    TEST_ASSERT_EQUAL(-77, out.count);
    TEST_ASSERT_EQUAL(9, out.counter);
    TEST_ASSERT_FALSE(out.valid);
}

static dahl_can_frame_t sample(uint64_t *seed)
{
    dahl_encoder_state_t in = {(int32_t)random_u32(seed), random_u32(seed) & 0x0F, true};
    dahl_can_frame_t frame;
    dahl_frames_pack_encoder(&frame, 0, &in);
    return frame;
}

static void flip(dahl_can_frame_t *frame, uint32_t bit)
{
    frame->data[bit / 8] = (uint8_t)(frame->data[bit / 8] ^ (1u << (bit % 8)));
}

static bool passes(const dahl_can_frame_t *frame)
{
    dahl_encoder_state_t out;
    return dahl_frames_unpack_encoder(frame, &out) == DAHL_FRAMES_GOOD;
}

/* All 64 + 2016 + 41664 of them; flips of the counter change the data id as well. */
static void test_no_one_or_two_flipped_bits_pass(void)
{
    uint64_t seed = 5;
    dahl_can_frame_t frame = sample(&seed);
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

static uint32_t count_passing_triples(dahl_can_frame_t *frame, uint32_t first)
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
    dahl_can_frame_t frame = sample(&seed);
    TEST_ASSERT_EQUAL(0, count_passing_triples(&frame, 12));
}

static void test_a_frame_of_one_kind_is_no_other(void)
{
    uint64_t seed = 7;
    dahl_friction_torque_t torque;
    dahl_node_status_t status;
    for (int i = 0; i < ROUNDS; i++) {
        dahl_can_frame_t frame = sample(&seed);
        TEST_ASSERT_EQUAL(DAHL_FRAMES_BAD_CRC, dahl_frames_unpack_torque(&frame, &torque));
        TEST_ASSERT_EQUAL(DAHL_FRAMES_BAD_CRC, dahl_frames_unpack_status(&frame, &status));
    }
}

static void test_a_bad_form_is_refused_before_anything_is_read(void)
{
    uint64_t seed = 8;
    const uint8_t flags[] = {DAHL_CAN_FRAME_EXTENDED, DAHL_CAN_FRAME_REMOTE, DAHL_CAN_FRAME_ERROR, DAHL_CAN_FRAME_FD};
    dahl_encoder_state_t untouched = {123456, 7, true};
    dahl_encoder_state_t out = untouched;
    for (uint8_t length = 0; length < 8; length++) {
        dahl_can_frame_t frame = sample(&seed);
        frame.length = length;
        TEST_ASSERT_EQUAL(DAHL_FRAMES_BAD_FORMAT, dahl_frames_unpack_encoder(&frame, &out));
    }
    for (uint32_t length = 9; length < 256; length++) { /* what no classic frame has, but the field can say */
        dahl_can_frame_t frame = sample(&seed);
        frame.length = (uint8_t)length;
        TEST_ASSERT_EQUAL(DAHL_FRAMES_BAD_FORMAT, dahl_frames_unpack_encoder(&frame, &out));
    }
    for (size_t i = 0; i < sizeof flags; i++) {
        dahl_can_frame_t frame = sample(&seed);
        frame.flags = flags[i];
        TEST_ASSERT_EQUAL(DAHL_FRAMES_BAD_FORMAT, dahl_frames_unpack_encoder(&frame, &out));
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
        TEST_ASSERT_EQUAL(DAHL_FRAMES_BAD_CRC, unpack(&wrong, &out_)); \
        TEST_ASSERT_EQUAL(DAHL_FRAMES_BAD_FORMAT, unpack(&shorter, &out_)); \
        TEST_ASSERT_EQUAL_MEMORY(&before_, &out_, sizeof out_);   \
    } while (0)

static void test_a_bad_frame_of_any_kind_touches_nothing(void)
{
    dahl_can_frame_t wrong = {.id = 0x100, .length = 8, .data = {0, 1, 2, 3, 4, 5, 6, 7}};
    dahl_can_frame_t shorter = wrong;
    shorter.length = 7;
    for (int kind = 0; kind < 16; kind++) { /* a CRC that is right for no kind */
        if (wrong.data[0] == dahl_frames_crc(wrong.data, (uint8_t)kind)) {
            wrong.data[0]++;
            kind = -1;
        }
    }
    ASSERT_UNTOUCHED(dahl_frames_unpack_encoder, dahl_encoder_state_t);
    ASSERT_UNTOUCHED(dahl_frames_unpack_torque, dahl_friction_torque_t);
    ASSERT_UNTOUCHED(dahl_frames_unpack_status, dahl_node_status_t);
    ASSERT_UNTOUCHED(dahl_frames_unpack_param_write, dahl_param_write_t);
    ASSERT_UNTOUCHED(dahl_frames_unpack_param_reply, dahl_param_reply_t);
    ASSERT_UNTOUCHED(dahl_frames_unpack_reset, dahl_node_reset_t);
}

/* SPDX-License-Identifier: MIT */
/*
 * Frames in both directions. A frame is accepted if and only if it is a classic data frame of 8 bytes with the right CRC,
 * computed here bit by bit. A refused frame leaves the output unchanged. An accepted frame packs to the same bytes, except for
 * unused bits.
 */
#include "dahl_frames.h"
#include "fuzz.h"

typedef struct {
    uint32_t id;
    uint8_t kind;
    uint8_t used[8]; /* bits of the data */
} kind_t;

static const kind_t kinds[] = {
    {DAHL_FRAMES_ID_ENCODER, DAHL_FRAMES_KIND_ENCODER, {0xFF, 0x1F, 0xFF, 0xFF, 0xFF, 0xFF, 0, 0}},
    {DAHL_FRAMES_ID_TORQUE, DAHL_FRAMES_KIND_TORQUE, {0xFF, 0xFF, 0x0F, 0, 0xFF, 0xFF, 0xFF, 0xFF}},
    {DAHL_FRAMES_ID_STATUS, DAHL_FRAMES_KIND_STATUS, {0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF}},
    {DAHL_FRAMES_ID_PARAM_WRITE, DAHL_FRAMES_KIND_PARAM_WRITE, {0xFF, 0x3F, 0xFF, 0, 0xFF, 0xFF, 0xFF, 0xFF}},
    {DAHL_FRAMES_ID_PARAM_REPLY, DAHL_FRAMES_KIND_PARAM_REPLY, {0xFF, 0xFF, 0xFF, 0, 0xFF, 0xFF, 0xFF, 0xFF}},
    {DAHL_FRAMES_ID_RESET, DAHL_FRAMES_KIND_RESET, {0xFF, 0xFF, 0, 0, 0, 0, 0, 0}},
};

enum { KINDS = sizeof kinds / sizeof kinds[0] };

typedef union {
    dahl_encoder_state_t encoder;
    dahl_friction_torque_t torque;
    dahl_node_status_t status;
    dahl_param_write_t param_write;
    dahl_param_reply_t param_reply;
    dahl_node_reset_t reset;
    uint8_t bytes[16];
} content_t;

static uint8_t shift_in(uint8_t crc, uint8_t byte)
{
    for (int bit = 7; bit >= 0; bit--) {
        int out = (crc >> 7 ^ byte >> bit) & 1;
        crc = (uint8_t)(crc << 1 & 0xFF) ^ (out ? 0x2F : 0);
    }
    return crc;
}

/* AUTOSAR E2E profile 2: bytes 1 to 7, then the data id that the counter selects. */
static uint8_t crc_of(const uint8_t *data, uint8_t kind)
{
    uint8_t crc = 0xFF;
    for (int i = 1; i < 8; i++) {
        crc = shift_in(crc, data[i]);
    }
    return shift_in(crc, (uint8_t)(kind << 4 | (data[1] & 15))) ^ 0xFF;
}

static dahl_frames_check_t unpack(size_t kind, const dahl_can_frame_t *frame, content_t *out)
{
    switch (kind) {
    case 0: return dahl_frames_unpack_encoder(frame, &out->encoder);
    case 1: return dahl_frames_unpack_torque(frame, &out->torque);
    case 2: return dahl_frames_unpack_status(frame, &out->status);
    case 3: return dahl_frames_unpack_param_write(frame, &out->param_write);
    case 4: return dahl_frames_unpack_param_reply(frame, &out->param_reply);
    default: return dahl_frames_unpack_reset(frame, &out->reset);
    }
}

static void pack(size_t kind, dahl_can_frame_t *frame, uint8_t node, const content_t *in)
{
    switch (kind) {
    case 0: dahl_frames_pack_encoder(frame, node, &in->encoder); break;
    case 1: dahl_frames_pack_torque(frame, node, &in->torque); break;
    case 2: dahl_frames_pack_status(frame, node, &in->status); break;
    case 3: dahl_frames_pack_param_write(frame, node, &in->param_write); break;
    case 4: dahl_frames_pack_param_reply(frame, node, &in->param_reply); break;
    default: dahl_frames_pack_reset(frame, node, &in->reset);
    }
}

static int is_classic(const dahl_can_frame_t *frame)
{
    return frame->length == 8 && !(frame->flags & (DAHL_CAN_FRAME_EXTENDED | DAHL_CAN_FRAME_REMOTE | DAHL_CAN_FRAME_ERROR | DAHL_CAN_FRAME_FD));
}

static void check_repack(size_t kind, const dahl_can_frame_t *frame, const content_t *content)
{
    dahl_can_frame_t again;
    memset(&again, 0xA5, sizeof again);
    pack(kind, &again, (uint8_t)frame->id, content);
    HOLDS(again.id == (kinds[kind].id | (frame->id & 15)) && again.length == 8 && again.flags == 0, "packing sets the whole head");
    HOLDS(again.data[0] == crc_of(again.data, kinds[kind].kind), "packing makes the CRC");
    for (int i = 1; i < 8; i++) {
        HOLDS(again.data[i] == (frame->data[i] & kinds[kind].used[i]), "an unpacked frame packs to the same bytes");
    }
}

static dahl_frames_check_t check_unpack(size_t kind, const dahl_can_frame_t *frame)
{
    content_t content, untouched;
    memset(&untouched, 0xA5, sizeof untouched);
    content = untouched;
    dahl_frames_check_t got = unpack(kind, frame, &content);
    dahl_frames_check_t wanted = !is_classic(frame)                                             ? DAHL_FRAMES_BAD_FORMAT
                            : frame->data[0] == crc_of(frame->data, kinds[kind].kind) ? DAHL_FRAMES_GOOD
                                                                                        : DAHL_FRAMES_BAD_CRC;
    HOLDS(got == wanted, "a frame is accepted if and only if format and CRC are right");
    if (got == DAHL_FRAMES_GOOD) {
        check_repack(kind, frame, &content);
    } else {
        HOLDS(memcmp(&content, &untouched, sizeof content) == 0, "a refused frame leaves the output unchanged");
    }
    return got;
}

static void check_pack(size_t kind, fuzz_bytes_t *bytes)
{
    content_t content = {.bytes = {0}};
    dahl_can_frame_t frame;
    uint8_t node = fuzz_u8(bytes), flag = fuzz_u8(bytes) & 1;
    for (size_t i = 0; i < sizeof content.bytes; i++) {
        content.bytes[i] = fuzz_u8(bytes);
    }
    if (kind == 0) { /* a bool is 0 or 1 */
        memcpy(&content.encoder.valid, &flag, 1);
    }
    pack(kind, &frame, node, &content);
    HOLDS(check_unpack(kind, &frame) == DAHL_FRAMES_GOOD, "a packed frame is good");
    for (size_t other = 0; other < KINDS; other++) {
        HOLDS(other == kind || check_unpack(other, &frame) == DAHL_FRAMES_BAD_CRC, "no frame passes for another kind");
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fuzz_bytes_t bytes = {data, size};
    uint8_t what = fuzz_u8(&bytes);
    size_t kind = what % KINDS;
    if (what >> 7) {
        check_pack(kind, &bytes);
        return 0;
    }
    dahl_can_frame_t frame = {.id = fuzz_u32(&bytes), .flags = fuzz_u8(&bytes), .length = fuzz_u8(&bytes)};
    for (int i = 0; i < 8; i++) {
        frame.data[i] = fuzz_u8(&bytes);
    }
    if (what & 0x40) {
        frame.data[0] = crc_of(frame.data, kinds[kind].kind);
        frame.length = what & 0x20 ? 8 : frame.length;
    }
    HOLDS(dahl_frames_crc(frame.data, kinds[kind].kind) == crc_of(frame.data, kinds[kind].kind), "the table is the polynomial");
    check_unpack(kind, &frame);
    return 0;
}

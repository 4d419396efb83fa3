/* SPDX-License-Identifier: MIT */
/** Frames of dahl_frames.h. Packing writes every byte. Unpacking checks the format, then the CRC, then reads. */
#include "dahl_frames.h"

#include <stddef.h>

/** CRC-8H2F, polynomial 0x2F, most significant bit first. A test compares it with an independent implementation. */
static const uint8_t crc_table[] = {
    0x00, 0x2F, 0x5E, 0x71, 0xBC, 0x93, 0xE2, 0xCD, 0x57, 0x78, 0x09, 0x26, 0xEB, 0xC4, 0xB5, 0x9A,
    0xAE, 0x81, 0xF0, 0xDF, 0x12, 0x3D, 0x4C, 0x63, 0xF9, 0xD6, 0xA7, 0x88, 0x45, 0x6A, 0x1B, 0x34,
    0x73, 0x5C, 0x2D, 0x02, 0xCF, 0xE0, 0x91, 0xBE, 0x24, 0x0B, 0x7A, 0x55, 0x98, 0xB7, 0xC6, 0xE9,
    0xDD, 0xF2, 0x83, 0xAC, 0x61, 0x4E, 0x3F, 0x10, 0x8A, 0xA5, 0xD4, 0xFB, 0x36, 0x19, 0x68, 0x47,
    0xE6, 0xC9, 0xB8, 0x97, 0x5A, 0x75, 0x04, 0x2B, 0xB1, 0x9E, 0xEF, 0xC0, 0x0D, 0x22, 0x53, 0x7C,
    0x48, 0x67, 0x16, 0x39, 0xF4, 0xDB, 0xAA, 0x85, 0x1F, 0x30, 0x41, 0x6E, 0xA3, 0x8C, 0xFD, 0xD2,
    0x95, 0xBA, 0xCB, 0xE4, 0x29, 0x06, 0x77, 0x58, 0xC2, 0xED, 0x9C, 0xB3, 0x7E, 0x51, 0x20, 0x0F,
    0x3B, 0x14, 0x65, 0x4A, 0x87, 0xA8, 0xD9, 0xF6, 0x6C, 0x43, 0x32, 0x1D, 0xD0, 0xFF, 0x8E, 0xA1,
    0xE3, 0xCC, 0xBD, 0x92, 0x5F, 0x70, 0x01, 0x2E, 0xB4, 0x9B, 0xEA, 0xC5, 0x08, 0x27, 0x56, 0x79,
    0x4D, 0x62, 0x13, 0x3C, 0xF1, 0xDE, 0xAF, 0x80, 0x1A, 0x35, 0x44, 0x6B, 0xA6, 0x89, 0xF8, 0xD7,
    0x90, 0xBF, 0xCE, 0xE1, 0x2C, 0x03, 0x72, 0x5D, 0xC7, 0xE8, 0x99, 0xB6, 0x7B, 0x54, 0x25, 0x0A,
    0x3E, 0x11, 0x60, 0x4F, 0x82, 0xAD, 0xDC, 0xF3, 0x69, 0x46, 0x37, 0x18, 0xD5, 0xFA, 0x8B, 0xA4,
    0x05, 0x2A, 0x5B, 0x74, 0xB9, 0x96, 0xE7, 0xC8, 0x52, 0x7D, 0x0C, 0x23, 0xEE, 0xC1, 0xB0, 0x9F,
    0xAB, 0x84, 0xF5, 0xDA, 0x17, 0x38, 0x49, 0x66, 0xFC, 0xD3, 0xA2, 0x8D, 0x40, 0x6F, 0x1E, 0x31,
    0x76, 0x59, 0x28, 0x07, 0xCA, 0xE5, 0x94, 0xBB, 0x21, 0x0E, 0x7F, 0x50, 0x9D, 0xB2, 0xC3, 0xEC,
    0xD8, 0xF7, 0x86, 0xA9, 0x64, 0x4B, 0x3A, 0x15, 0x8F, 0xA0, 0xD1, 0xFE, 0x33, 0x1C, 0x6D, 0x42,
};

static uint8_t crc_step(uint8_t crc, uint8_t byte)
{
    return crc_table[crc ^ byte];
}

uint8_t dahl_frames_crc(const uint8_t data[8], uint8_t kind)
{
    uint8_t crc = 0xFF;
    for (size_t i = 1; i < 8; i++) {
        crc = crc_step(crc, data[i]);
    }
    return (uint8_t)(crc_step(crc, (uint8_t)((kind << 4) | (data[1] & 0x0F))) ^ 0xFF);
}

static void put_i32(uint8_t *to, int32_t value)
{
    uint32_t bits = (uint32_t)value;
    to[0] = (uint8_t)bits;
    to[1] = (uint8_t)(bits >> 8);
    to[2] = (uint8_t)(bits >> 16);
    to[3] = (uint8_t)(bits >> 24);
}

static int32_t get_i32(const uint8_t *from)
{
    uint32_t bits = (uint32_t)from[0] | (uint32_t)from[1] << 8 | (uint32_t)from[2] << 16 | (uint32_t)from[3] << 24;
    return (int32_t)bits;
}

static uint8_t nibbles(uint32_t low, uint32_t high)
{
    return (uint8_t)((low & 0x0Fu) | ((high & 0x0Fu) << 4));
}

static void begin(dahl_can_frame_t *frame, uint32_t id, uint8_t node)
{
    *frame = (dahl_can_frame_t){.id = id | (node & 0x0Fu), .length = 8};
}

static dahl_frames_check_t check_frame(const dahl_can_frame_t *frame, uint8_t kind)
{
    if (frame->length != 8 || (frame->flags & DAHL_CAN_FRAME_FOREIGN) != 0) {
        return DAHL_FRAMES_BAD_FORMAT;
    }
    return frame->data[0] == dahl_frames_crc(frame->data, kind) ? DAHL_FRAMES_GOOD : DAHL_FRAMES_BAD_CRC;
}

/* --- from dahl.dbc by tools/generators/frames.py: begin --- */
void dahl_frames_pack_encoder(dahl_can_frame_t *frame, uint8_t node, const dahl_encoder_state_t *in)
{
    begin(frame, DAHL_FRAMES_ID_ENCODER, node);
    frame->data[1] = nibbles(in->counter, in->valid ? 1u : 0u);
    put_i32(&frame->data[2], in->count);
    frame->data[0] = dahl_frames_crc(frame->data, DAHL_FRAMES_KIND_ENCODER);
}

dahl_frames_check_t dahl_frames_unpack_encoder(const dahl_can_frame_t *frame, dahl_encoder_state_t *out)
{
    dahl_frames_check_t result = check_frame(frame, DAHL_FRAMES_KIND_ENCODER);
    if (result == DAHL_FRAMES_GOOD) {
        out->counter = frame->data[1] & 0x0F;
        out->valid = (frame->data[1] & 0x10) != 0;
        out->count = get_i32(&frame->data[2]);
    }
    return result;
}

void dahl_frames_pack_torque(dahl_can_frame_t *frame, uint8_t node, const dahl_friction_torque_t *in)
{
    begin(frame, DAHL_FRAMES_ID_TORQUE, node);
    frame->data[1] = nibbles(in->counter, in->state);
    frame->data[2] = nibbles(in->echo, 0);
    put_i32(&frame->data[4], in->torque_q30);
    frame->data[0] = dahl_frames_crc(frame->data, DAHL_FRAMES_KIND_TORQUE);
}

dahl_frames_check_t dahl_frames_unpack_torque(const dahl_can_frame_t *frame, dahl_friction_torque_t *out)
{
    dahl_frames_check_t result = check_frame(frame, DAHL_FRAMES_KIND_TORQUE);
    if (result == DAHL_FRAMES_GOOD) {
        out->counter = frame->data[1] & 0x0F;
        out->state = frame->data[1] >> 4;
        out->echo = frame->data[2] & 0x0F;
        out->torque_q30 = get_i32(&frame->data[4]);
    }
    return result;
}

void dahl_frames_pack_status(dahl_can_frame_t *frame, uint8_t node, const dahl_node_status_t *in)
{
    begin(frame, DAHL_FRAMES_ID_STATUS, node);
    frame->data[1] = nibbles(in->counter, in->state);
    frame->data[2] = in->errors;
    frame->data[3] = in->lost;
    frame->data[4] = in->corrupt;
    frame->data[5] = in->out_of_step;
    frame->data[6] = nibbles(in->version_minor, in->version_major);
    frame->data[7] = in->timeout;
    frame->data[0] = dahl_frames_crc(frame->data, DAHL_FRAMES_KIND_STATUS);
}

dahl_frames_check_t dahl_frames_unpack_status(const dahl_can_frame_t *frame, dahl_node_status_t *out)
{
    dahl_frames_check_t result = check_frame(frame, DAHL_FRAMES_KIND_STATUS);
    if (result == DAHL_FRAMES_GOOD) {
        out->counter = frame->data[1] & 0x0F;
        out->state = frame->data[1] >> 4;
        out->errors = frame->data[2];
        out->lost = frame->data[3];
        out->corrupt = frame->data[4];
        out->out_of_step = frame->data[5];
        out->version_minor = frame->data[6] & 0x0F;
        out->version_major = frame->data[6] >> 4;
        out->timeout = frame->data[7];
    }
    return result;
}

void dahl_frames_pack_param_write(dahl_can_frame_t *frame, uint8_t node, const dahl_param_write_t *in)
{
    begin(frame, DAHL_FRAMES_ID_PARAM_WRITE, node);
    frame->data[1] = nibbles(in->counter, in->write & 3u);
    frame->data[2] = in->param;
    put_i32(&frame->data[4], (int32_t)in->value);
    frame->data[0] = dahl_frames_crc(frame->data, DAHL_FRAMES_KIND_PARAM_WRITE);
}

dahl_frames_check_t dahl_frames_unpack_param_write(const dahl_can_frame_t *frame, dahl_param_write_t *out)
{
    dahl_frames_check_t result = check_frame(frame, DAHL_FRAMES_KIND_PARAM_WRITE);
    if (result == DAHL_FRAMES_GOOD) {
        out->counter = frame->data[1] & 0x0F;
        out->write = (frame->data[1] >> 4) & 3;
        out->param = frame->data[2];
        out->value = (uint32_t)get_i32(&frame->data[4]);
    }
    return result;
}

void dahl_frames_pack_param_reply(dahl_can_frame_t *frame, uint8_t node, const dahl_param_reply_t *in)
{
    begin(frame, DAHL_FRAMES_ID_PARAM_REPLY, node);
    frame->data[1] = nibbles(in->counter, in->result);
    frame->data[2] = in->param;
    put_i32(&frame->data[4], (int32_t)in->value);
    frame->data[0] = dahl_frames_crc(frame->data, DAHL_FRAMES_KIND_PARAM_REPLY);
}

dahl_frames_check_t dahl_frames_unpack_param_reply(const dahl_can_frame_t *frame, dahl_param_reply_t *out)
{
    dahl_frames_check_t result = check_frame(frame, DAHL_FRAMES_KIND_PARAM_REPLY);
    if (result == DAHL_FRAMES_GOOD) {
        out->counter = frame->data[1] & 0x0F;
        out->result = frame->data[1] >> 4;
        out->param = frame->data[2];
        out->value = (uint32_t)get_i32(&frame->data[4]);
    }
    return result;
}

void dahl_frames_pack_reset(dahl_can_frame_t *frame, uint8_t node, const dahl_node_reset_t *in)
{
    begin(frame, DAHL_FRAMES_ID_RESET, node);
    frame->data[1] = nibbles(in->counter, in->what);
    frame->data[0] = dahl_frames_crc(frame->data, DAHL_FRAMES_KIND_RESET);
}

dahl_frames_check_t dahl_frames_unpack_reset(const dahl_can_frame_t *frame, dahl_node_reset_t *out)
{
    dahl_frames_check_t result = check_frame(frame, DAHL_FRAMES_KIND_RESET);
    if (result == DAHL_FRAMES_GOOD) {
        out->counter = frame->data[1] & 0x0F;
        out->what = frame->data[1] >> 4;
    }
    return result;
}
/* --- from dahl.dbc: end --- */

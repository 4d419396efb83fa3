/* SPDX-License-Identifier: MIT */
/* The six messages, for any frame and any signals: no undefined behaviour, *out is written only from a good frame, and a packed
 * message is unpacked unchanged. */
#include <string.h>

#include "node_library.c" /* receiver and frames, written by test_cbmc.py */

#define CHECK(message, type, is_same)                                                                                       \
    void check_##message(dahl_can_frame_t frame, uint8_t node, type in)                                                          \
    {                                                                                                                       \
        unsigned char any[sizeof(type)], kept[sizeof(type)];                                                                \
        type out;                                                                                                           \
        memcpy(kept, any, sizeof kept);                                                                                     \
        if (dahl_frames_unpack_##message(&frame, (type *)(void *)any) != DAHL_FRAMES_GOOD) {                                          \
            __CPROVER_assert(memcmp(any, kept, sizeof kept) == 0, "nothing written from a bad frame");                      \
        }                                                                                                                   \
        dahl_frames_pack_##message(&frame, node, &in);                                                                           \
        __CPROVER_assert(frame.length == 8 && frame.flags == 0 && (frame.id & ~0xF0u) == (0x100u | (node & 15u)), "form");   \
        __CPROVER_assert(dahl_frames_unpack_##message(&frame, &out) == DAHL_FRAMES_GOOD && is_same, "what was packed comes out");     \
    }

CHECK(encoder, dahl_encoder_state_t, out.count == in.count && out.counter == (in.counter & 15) && out.valid == (in.valid != 0))
CHECK(torque, dahl_friction_torque_t,
      out.torque_q30 == in.torque_q30 && out.counter == (in.counter & 15) && out.state == (in.state & 15) &&
          out.echo == (in.echo & 15))
CHECK(status, dahl_node_status_t,
      out.counter == (in.counter & 15) && out.state == (in.state & 15) && out.errors == in.errors && out.lost == in.lost &&
          out.corrupt == in.corrupt && out.out_of_step == in.out_of_step &&
          out.version_major == (in.version_major & 15) && out.version_minor == (in.version_minor & 15) &&
          out.timeout == in.timeout)
CHECK(param_write, dahl_param_write_t,
      out.value == in.value && out.counter == (in.counter & 15) && out.param == in.param && out.write == (in.write & 3))
CHECK(param_reply, dahl_param_reply_t,
      out.value == in.value && out.counter == (in.counter & 15) && out.param == in.param && out.result == (in.result & 15))
CHECK(reset, dahl_node_reset_t, out.counter == (in.counter & 15) && out.what == (in.what & 15))

/* Data of exactly 8 bytes, so that a read of a ninth byte is an error. In a frame it would read padding. */
void check_crc(uint8_t kind)
{
    uint8_t data[8];
    (void)dahl_frames_crc(data, kind);
}

/* SPDX-License-Identifier: MIT */
/* frame_bits: length of a classic frame on the bus. */
#ifndef FRAME_BITS_H
#define FRAME_BITS_H

#include "dahl_can_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Number of bits, including stuff bits, end of frame and intermission: 111 to 135 for 8 bytes and an id of 11 bits. */
uint32_t can_frame_bits(const dahl_can_frame_t *frame);

#ifdef __cplusplus
}
#endif

#endif

/* SPDX-License-Identifier: MIT */
#ifndef HAND_GUIDING_H
#define HAND_GUIDING_H

#include <stdint.h>

/* Payload of the joint. If it changes, stop the guiding and call the init again. */
typedef struct {
    float weight; /* N m of the arm and its tool when the arm is horizontal; cancelled */
    float load;   /* N m: the largest torque that this leaves in any pose: errors of the weight, cables, springs */
} hand_guiding_payload_t;

/* Start with the arm at this count; 0 is horizontal. Returns 0, or a code of dahl_prepare() or dahl_compensator_prepare():
 * leave the motor off and the brake closed. */
int hand_guiding_init(const hand_guiding_payload_t *payload, int32_t count);

/* Return the torque of the motor in N m, each millisecond. count: of the encoder; not used if is_good is 0. */
float hand_guiding_tick(int32_t count, int is_good);

#endif

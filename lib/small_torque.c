/* SPDX-License-Identifier: MIT */
/* The rare end of the conversion to float: torques next to nothing, and none. */
#include "torque.h"

float dahl_small_torque(uint64_t product, uint32_t scale, uint32_t sign)
{
    if (product == 0) {
        return 0.0f;
    }
    if (product >> 33 != 0) {
        return dahl_float_of(sign | dahl_pack((uint32_t)(product >> 33), (uint32_t)(product >> 1), scale - (31u << 24)));
    }
    return dahl_float_of(sign | dahl_pack((uint32_t)(product >> 2), (uint32_t)product << 30, scale - (62u << 24)));
}

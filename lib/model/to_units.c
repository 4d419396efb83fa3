/* SPDX-License-Identifier: MIT */
/**
 * Convert a torque ratio to whole units.
 *
 * An offset of 2, the magnitude of the least ratio, makes all numbers unsigned: (ratio + 2) Fc = ratio Fc + 2 Fc.
 */
#include "../arith/fixed.h"
#include "dahl.h"

#define HALF_Q30 (DAHL_ONE_Q30 / 2)

int32_t dahl_to_units(int32_t ratio_q30, uint32_t Fc_units)
{
    uint32_t Fc = Fc_units < DAHL_ONE_Q30 ? Fc_units : DAHL_ONE_Q30;
    uint64_t from_least = dahl_mul((uint32_t)ratio_q30 + 2 * DAHL_ONE_Q30, Fc) + HALF_Q30;
    return (int32_t)((uint32_t)(from_least >> 30) - 2 * Fc);
}

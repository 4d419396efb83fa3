/* SPDX-License-Identifier: MIT */
/* A torque in whole units from its ratio to Fc. The ratio is counted from -2, where it is least, so that nothing has a sign:
 *     (ratio + 2) Fc = ratio Fc + 2 Fc */
#include "../arith/fixed.h"
#include "dahl.h"

#define HALF_Q30 (DAHL_ONE_Q30 / 2)

int32_t dahl_to_units(int32_t ratio_q30, uint32_t Fc_units)
{
    uint32_t Fc = Fc_units < DAHL_ONE_Q30 ? Fc_units : DAHL_ONE_Q30;
    uint64_t from_least = dahl_mul((uint32_t)ratio_q30 + 2 * DAHL_ONE_Q30, Fc) + HALF_Q30;
    return (int32_t)((uint32_t)(from_least >> 30) - 2 * Fc);
}

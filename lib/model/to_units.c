/* SPDX-License-Identifier: MIT */
/** Convert a torque ratio to whole units. */
#include "../arith/scale.h"
#include "dahl.h"

#define MAX_UNITS (UINT32_C(1) << 30)

int32_t dahl_to_units(int32_t ratio_q30, uint32_t Fc_units)
{
    return dahl_scale_q30(ratio_q30, (int32_t)dahl_least(Fc_units, MAX_UNITS));
}

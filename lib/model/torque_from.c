/* SPDX-License-Identifier: MIT */
/** Conversion to N m for cores whose calls share one copy of it. */
#include "torque.h"

#if DAHL_V6M
DAHL_WEAK_TICK float dahl_torque_from(dahl_real_t Fc, uint64_t w)
{
    return dahl_torque_inline(Fc, w);
}
#endif
